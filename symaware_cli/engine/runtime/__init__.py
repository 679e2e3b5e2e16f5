"""The execution of a simulation: scheduling in both modes, pacing, faults, worker processes and interruptions."""
