"""Worlds: bodies, models, contacts, rosters and snapshots; sensor readings, time, randomness and numeric arrays."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
