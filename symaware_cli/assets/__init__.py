"""Files of robots and meshes from other sources, checked before an engine reads them."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
