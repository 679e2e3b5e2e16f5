"""Geometry without agents: shapes, convex pieces and their distances, nearby pairs, rays, paths, rotations."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
