"""Worlds of physics engines, and the base classes for worlds of other engines."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
