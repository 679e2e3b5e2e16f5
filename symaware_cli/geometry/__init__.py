"""Geometry that knows nothing of agents: convex pieces and how far they are apart, who is near whom, rotations."""
