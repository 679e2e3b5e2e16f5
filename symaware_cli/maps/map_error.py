"""The error of the readers of maps."""

from __future__ import annotations


class MapError(ValueError):
    """A file is not a usable map; the message gives the reason, and the place in the file."""
