"""The state of a simulation: taken apart into plain values, and put back."""
