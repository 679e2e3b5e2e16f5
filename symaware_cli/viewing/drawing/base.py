"""What all drawings have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod

from symaware_cli.viewing.cast import Cast
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.excerpt import Excerpt
from symaware_cli.viewing.stage import Stage


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
