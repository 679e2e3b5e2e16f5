"""Samples of the parameters that a sweep draws: a value of each for every replicate."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from symaware_cli.study.statistics.design import independent, latin_hypercube, sobol
from symaware_cli.study.statistics.interval_estimate import Array
from symaware_cli.study.sweep_document import SweepDocument

#: How many samples are turned into values at a time.
_AT_ONCE = 1024


class Samples:
    """What each sample draws; it depends on the sweep's seed and design and on the sample's number alone.

    Attributes:
        paths: The paths of what is drawn.
    """

    def __init__(self, document: SweepDocument) -> None:
        self._document = document
        self.paths = tuple(document.drawn)
        self._block: tuple[int, list[tuple[Any, ...]]] = (-1, [])

    def of(self, number: int) -> Mapping[str, Any]:
        """Return the values of a sample by their paths."""
        if not self.paths:
            return {}
        block, place = divmod(number, _AT_ONCE)
        if self._block[0] != block:
            columns = [
                each.distribution.values(points)
                for each, points in zip(self._document.drawn.values(), self._points(block).T, strict=True)
            ]
            self._block = (block, list(zip(*columns, strict=True)))
        return dict(zip(self.paths, self._block[1][place], strict=True))

    def _points(self, block: int) -> Array:
        """Points between 0 and 1 for a block of samples; shape (n, d)."""
        start = block * _AT_ONCE
        if self._document.design == "random":
            return independent(self._document.seed, self.paths, np.arange(start, start + _AT_ONCE))
        return self._whole[start : start + _AT_ONCE]

    @cached_property
    def _whole(self) -> Array:
        """All points of a design whose points depend on each other."""
        design = sobol if self._document.design == "sobol" else latin_hypercube
        return design(self._document.seed, self.paths, self._document.runs)
