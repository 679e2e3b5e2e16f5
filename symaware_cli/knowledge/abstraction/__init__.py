"""Finite abstractions of the workspace: transition systems, and knowledge models that make them."""
