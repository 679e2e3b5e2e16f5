"""Pictures of sweeps: the results of each combination of parameters as curves, maps and distributions."""
