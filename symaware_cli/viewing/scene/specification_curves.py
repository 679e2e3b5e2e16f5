"""Specifications: bounds of the robustness over time, and a ring around agents that violate one."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording import logged_events
from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.palette import RISK
from symaware_cli.viewing.scene.marks import Curves, Rings
from symaware_cli.viewing.scene.scene import Drawing
from symaware_cli.viewing.views import RunView

Array = NDArray[np.float64]

#: Radius of the ring around an agent that violates a specification, in radii of the body.
_REACH = 1.8


class SpecificationCurves(Drawing):
    """Draws a curve for each agent or pair: the upper bound of the robustness, and finally the robustness.

    Attributes:
        most: Maximum number of rows with a curve each; with more, only the least is drawn.
    """

    most = 8

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._upper = {name: np.full(len(rows), np.nan) for name, rows in run_view.specifications.items()}

    def marks(self, chunk: Chunk) -> Iterator[Curves]:
        """Yield a mark for each specification."""
        for name, rows in self.run_view.specifications.items():
            told = [(time, each) for time, each in chunk.entries.get(f"/specifications/{name}", ()) if each.upper]
            if not told:
                continue
            values = np.empty((len(told), len(rows)))
            for number, (_, content) in enumerate(told):
                known = self._upper[name] = self._upper[name].copy()
                known[list(content.rows) or slice(None)] = content.upper
                values[number] = np.where(np.isfinite(known), known, np.nan)
            names = [" and ".join(agents) or name for agents in rows]
            if len(rows) > self.most:
                values, names = np.fmin.reduce(values, axis=1)[:, None], ["least"]
            yield Curves(
                path=f"curves/specifications/{name}",
                times=np.array([time for time, _ in told], np.int64),
                values=values,
                names=names,
                keep="least",
                level=("zero", 0.0),
            )


class EverySpecificationCurve(SpecificationCurves):
    """Draws a curve for each agent or pair, however many there are."""

    most = sys.maxsize


class Violations(Drawing):
    """Draws a ring around each agent from when it violates a specification."""

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        #: When each agent first violated a specification [ns].
        self._since: dict[str, int] = {}

    def marks(self, chunk: Chunk) -> Iterator[Rings]:
        """Yield a mark for each of these agents."""
        for time, message in chunk.entries.get("/events", ()):
            if message.name == "violated":
                for agent in logged_events.event(time, message).data.get("agents", ()):
                    if agent in self.run_view.place:
                        self._since.setdefault(agent, time)
        for agent, since in self._since.items():
            group_view = self.run_view.group_views[self.run_view.place[agent][0]]
            frames = chunk.frames.get(group_view.state_topic)
            times = np.empty(0, np.int64) if frames is None else frames.times[frames.times >= since]
            if len(times):
                centres = self.places(agent, times, chunk)
                yield Rings(
                    path=f"world/violations/{agent}",
                    layer="violations",
                    times=times,
                    counts=np.ones(len(times), np.int64),
                    colours=np.array(RISK, np.uint8),
                    centres=centres,
                    radii=np.full(len(times), _REACH * group_view.extent),
                    width=2.5,
                )
