"""What agents know as finite models: transition systems, games, strategies, and the components that follow them."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
