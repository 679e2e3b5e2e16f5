"""Studies: sweeps of many runs of a scenario, and the statistics of their results."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
