"""The engine: time, turns, networks, faults, the stock of models and components, and the kinematic world."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
