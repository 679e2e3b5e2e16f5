"""The built-in kinds of faults, a class for each; they are found by the entry points of `symaware.faults` only."""
