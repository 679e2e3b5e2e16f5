"""Expressions and formulas about a run, and the monitors that evaluate them."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
