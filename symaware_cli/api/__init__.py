"""The Python API: load a scenario, run or step it, and read the results (docs/python.md).

Nothing is imported here, so that importing one module does not load the others.
"""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
