"""Geometry without agents: shapes, convex pieces and their distances, nearby pairs, rays, paths, rotations."""
