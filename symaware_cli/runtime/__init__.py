"""When things happen: the simulation, both modes, pace, faults and interruptions."""
