"""The error of the readers of recordings."""

from __future__ import annotations


class BagError(ValueError):
    """A file is no recording that can be used; the message says why."""
