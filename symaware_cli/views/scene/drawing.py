"""Drawings: each draws one kind of content of a log as marks.

Reasons: docs/decisions/0067-drawings-exports-and-reports-are-plugins.md
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Set
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from symaware_cli.views.chunk import Chunk
from symaware_cli.views.detail import Detail
from symaware_cli.views.postures import postures_of
from symaware_cli.views.scene.marks import Mark
from symaware_cli.views.views import GroupView, ObstacleView, RunView
from symaware_cli.world import PluginKind

Array = NDArray[np.float64]

Output: TypeAlias = Literal["replay", "beside", "foxglove", "plot"]
"""What marks are drawn for: a replay in Rerun, the second run beside it, Foxglove, or plots of a whole run."""


class Drawing(ABC):
    """Draws one kind of content of a log as marks.

    Attributes:
        outputs: The kinds of output in which it draws.
        order: Drawings draw in this order, which matters where marks cover each other; those of this package have
            orders below 1,000.
        panel: The name of a panel of its own for its `Curves`, whose paths then begin with ``curves/<panel>/``: a view
            in replays, and a panel of plots. Empty for none.
        run_view: The run to draw.
        detail: The level of detail.
    """

    outputs: ClassVar[frozenset[Output]] = frozenset({"replay", "foxglove"})
    order: ClassVar[float] = 1000
    panel: ClassVar[str] = ""

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        self.run_view = run_view
        self.detail = detail

    @abstractmethod
    def marks(self, chunk: Chunk) -> Iterable[Mark]:
        """Yield the marks of a chunk; called in the order of time."""

    def topics(self) -> Iterable[str]:
        """Return the topics of the log that a plot has to read for it; replays and exports read all topics.

        Without them, a plot reads the topics that its panels need.
        """
        return ()

    def legend(self) -> Iterable[tuple[str, str]]:
        """Yield the marks that are seen, and their meaning, for the explanation of a replay."""
        return ()

    def shown_rows(self, group_view: GroupView) -> list[int]:
        """Return the rows of the agents whose awareness is shown: all, or with many agents those in focus."""
        return [row for row, id in enumerate(group_view.agents) if self.detail.awareness or id in self.detail.focus]

    def places(self, who: str, times: NDArray[np.int64], chunk: Chunk) -> Array:
        """Return positions of an agent or entity at some instants of a chunk; (len(times), 3) [m], NaN if unknown."""
        if who in self.run_view.place:
            group, row = self.run_view.place[who]
            group_view = self.run_view.group_views[group]
            frames = chunk.frames.get(group_view.state_topic)
            known = None if frames is None else group_view.positions(frames.of(times, row))
        else:
            frames = chunk.frames.get(f"/world/{who}/state")
            known = None if frames is None else self.run_view.obstacle_views[who].positions(frames.of(times, 0))
        unknown = (
            self.run_view.obstacle_views[who].position if who in self.run_view.obstacle_views else np.full(3, np.nan)
        )
        if known is None:
            return np.broadcast_to(unknown, (len(times), 3))
        return np.where(np.isnan(known), unknown, known)

    def postures(self, who: GroupView | ObstacleView, times: NDArray[np.int64], chunk: Chunk) -> tuple[Array, Array]:
        """Return the poses of the bodies of a group, or of an entity, at some instants of a chunk.

        Returns:
            Positions (k, n, 3) [m] and quaternions x, y, z, w (k, n, 4); NaN for agents where unknown.
        """
        return postures_of(who, times, chunk)


class _DrawingKind(PluginKind):
    """The kind of plugin `drawing`; drawings declare the kinds of output in which they draw."""

    def fault(self, loaded: Any) -> str | None:
        """Return why an object is no drawing, or that it declares an unknown kind of output; None without a fault."""
        fault = super().fault(loaded)
        if fault is not None:
            return fault
        if not isinstance(loaded.outputs, Set) or not loaded.outputs <= {*get_args(Output)}:
            return f"has outputs that are not a set of {', '.join(get_args(Output))}"
        if not isinstance(loaded.order, int | float) or not math.isfinite(loaded.order):
            return "has an order that is not a number"
        if not isinstance(loaded.panel, str) or re.fullmatch(r"[a-z0-9. _-]*", loaded.panel) is None:
            return "has a panel that is not a name in lower case"
        return None


DRAWING = _DrawingKind("drawing", "symaware.drawings", (Drawing,))
