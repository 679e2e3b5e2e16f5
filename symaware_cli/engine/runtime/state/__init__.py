"""Capturing and restoring the state of a simulation, as a table of plain values."""
