"""When things happen: the simulation, the synchronous mode, faults and interruptions."""
