"""The error of the readers of recordings."""

from __future__ import annotations


class BagError(ValueError):
    """A file is not a usable recording; the message gives the reason."""
