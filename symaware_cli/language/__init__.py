"""Scenario files: reading, composing and validating them, and building simulations from them."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
