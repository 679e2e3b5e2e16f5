"""One run in several processes: host and members, transports and their section of scenarios, merging of logs."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
