"""Fuzzing targets that show each kind of finding."""
