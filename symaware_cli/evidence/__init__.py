"""Evidence from runs and sweeps: checks, repetitions, comparisons, branches, claims, counterexamples, reports."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
