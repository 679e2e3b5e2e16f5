"""Logs as pictures, tables and pages: replays in Rerun, plots with matplotlib, exports, templates of HTML."""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
