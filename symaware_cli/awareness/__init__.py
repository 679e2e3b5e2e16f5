"""The situational awareness of agents, of themselves and of others, in columns; and their knowledge."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
