"""Goals and intents in plots: the marks of a scene that are up at one instant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording.reader import Log
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.scene.base import Drawing
from symaware_cli.viewing.scene.goals import Goals
from symaware_cli.viewing.scene.intents import Intents
from symaware_cli.viewing.scene.marks import Crosses, Lines, Mark
from symaware_cli.viewing.scene.scene import Scene
from symaware_cli.viewing.views import RunView

Array = NDArray[np.float64]

#: Plots show what belongs to the agents that they are about, and no more.
_DETAIL = Detail(focus=(), labels=False, minds=True, curves=False, trail=0.0, single=False, words="")


def goals(log: Log, run_view: RunView, at: int) -> dict[str, Array]:
    """Where agents want to go, as far as they know at an instant [ns]; by agent (m, 2) from above [m]."""
    topics = [f"/agents/{name}/knowledge" for name in run_view.group_views]
    found: dict[str, list[Array]] = {}
    for mark in _up(log, run_view, Goals, topics, at):
        if isinstance(mark, Crosses) and mark.who is not None:
            for row, position in zip(mark.who.tolist(), mark.positions, strict=True):
                found.setdefault(mark.names[row], []).append(position[:2])
    return {agent: np.array(points) for agent, points in found.items()}


def intents(log: Log, run_view: RunView, at: int) -> dict[str, Array]:
    """Where agents mean to go at an instant [ns]; by agent (m, 2) from above, the earliest first [m]."""
    views = run_view.group_views.values()
    topics = [topic for group_view in views for _, topic in group_view.drawn("path")]
    found: dict[str, Array] = {}
    for mark in _up(log, run_view, Intents, topics, at):
        if isinstance(mark, Lines) and mark.who is not None:
            count = int(np.asarray(mark.counts)[-1])
            lines = np.split(mark.points, np.cumsum(mark.lengths)[:-1])
            for row, line in zip(mark.who[len(lines) - count :].tolist(), lines[len(lines) - count :], strict=True):
                found.setdefault(mark.names[row], line[:, :2])
    return found


def _up(log: Log, run_view: RunView, drawing: type[Drawing], topics: Sequence[str], at: int) -> list[Mark]:
    """The marks that are up at an instant [ns]; each may have earlier instants, too."""
    scene = Scene(run_view, _DETAIL, [drawing])
    recorded = [topic for topic in topics if topic in log.topics]
    up: dict[str, Mark] = {}
    for chunk in scene.chunk_reader().chunks(log.messages(recorded, end=at + 1) if recorded else ()):
        up |= {mark.path: mark for mark in scene.marks(chunk) if len(mark.times)}
    return list(up.values())
