"""Worlds of physics engines, and what a world of another engine is made of."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
