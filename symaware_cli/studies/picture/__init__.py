"""Pictures of sweeps: what each combination of parameters came to, as curves, maps and distributions."""
