"""The error of the readers of maps."""

from __future__ import annotations


class MapError(ValueError):
    """A file is no map that can be used; the message says why, and where in the file."""
