"""What all drawings have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from symaware_cli.viewing.cast import Cast, in_space
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.excerpt import Excerpt
from symaware_cli.viewing.stage import Stage

Array = NDArray[np.float64]


class Drawing(ABC):
    """Something drawn in a replay.

    Attributes:
        cast: Who takes part.
        detail: How much to show.
        stage: Where to draw.
    """

    def __init__(self, cast: Cast, detail: Detail, stage: Stage) -> None:
        self.cast = cast
        self.detail = detail
        self.stage = stage

    def begin(self) -> None:  # noqa: B027 (not every drawing has something)
        """Put up what holds for all times."""

    @abstractmethod
    def draw(self, excerpt: Excerpt) -> None:
        """Draw a stretch of the log; called in the order of time."""

    def places(self, who: str, times: NDArray[np.int64], excerpt: Excerpt) -> Array:
        """Where somebody or something is at some instants of an excerpt; (len(times), 3) [m], NaN if unknown."""
        if who in self.cast.place:
            group, row = self.cast.place[who]
            troupe = self.cast.troupes[group]
            frames = excerpt.frames.get(troupe.whereabouts)
            known = None if frames is None else troupe.positions(frames.at(times)[:, row])
        else:
            frames = excerpt.frames.get(f"/world/{who}/state")
            known = None if frames is None else in_space(frames.at(times)[:, 0, :-1])
        unknown = self.cast.props[who].position if who in self.cast.props else np.full(3, np.nan)
        if known is None:
            return np.broadcast_to(unknown, (len(times), 3))
        return np.where(np.isnan(known), unknown, known)
