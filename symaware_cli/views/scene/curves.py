"""Curves over time: separation and awareness; and tables of all numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Part
from symaware_cli.geometry import BodyOutlines, Proximity
from symaware_cli.views.chunk import Chunk
from symaware_cli.views.detail import Detail
from symaware_cli.views.palette import AGENTS
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Curves, Numbers
from symaware_cli.views.scene.signals import tables_of
from symaware_cli.views.views import GroupView, RunView

Array = NDArray[np.float64]

_NEVER = np.empty(0, np.int64)


class SeparationCurve(Drawing):
    """Draws the least distance between the outlines of two agents, with a line at 0, where bodies touch."""

    outputs: ClassVar = frozenset({"replay"})
    order: ClassVar = 250

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        group_views = run_view.group_views.values()
        shapes = [group_view.shape for group_view in group_views]
        counts = [len(group_view.agents) for group_view in group_views]
        self._bodies = BodyOutlines([shape.pieces[0] if shape else None for shape in shapes], counts)

    def marks(self, chunk: Chunk) -> Iterator[Curves]:
        """Yield the distance with its line at 0."""
        if self.run_view.agent_count < 2:
            return
        found = {
            name: chunk.frames.get(group_view.state_topic) for name, group_view in self.run_view.group_views.items()
        }
        times = np.unique(np.concatenate([frames.times for frames in found.values() if frames] or [_NEVER]))
        if not len(times):
            return
        shape = (len(times), self.run_view.agent_count)
        places, headings = np.full((*shape, 3), np.nan), np.zeros(shape)
        first = 0
        for name, group_view in self.run_view.group_views.items():
            some, frames = slice(first, first + len(group_view.agents)), found[name]
            first = some.stop
            if frames:
                states = frames.at(times)
                places[:, some] = group_view.positions(states)
                turned = group_view.headings(states)
                headings[:, some] = 0.0 if turned is None else turned
        smallest = np.array([self._smallest(*each) for each in zip(places, headings, strict=True)])
        yield Curves(
            path="curves/separation/smallest",
            times=times,
            values=smallest[:, None],
            names=["closest two agents [m]"],
            colours=[AGENTS[3]],
            keep="least",
            level=("bodies touch", 0.0),
        )

    def _smallest(self, places: Array, headings: Array) -> float:
        """Return the least separation of the agents present at an instant; infinity with fewer than two."""
        present = np.flatnonzero(np.isfinite(places).all(axis=1))
        bodies = self._bodies if len(present) == len(places) else self._bodies.some(present)
        found = bodies.nearest(places[present], headings[present], Proximity())
        return np.inf if found is None else found.gap


class AwarenessCurves(Drawing):
    """Draws control input, parts of awareness and signals of each agent in focus, with names and units."""

    outputs: ClassVar = frozenset({"replay"})
    order: ClassVar = 260

    def marks(self, chunk: Chunk) -> Iterator[Curves]:
        """Yield the curves of the agents in focus."""
        for agent in self.detail.focus:
            group, row = self.run_view.place[agent]
            group_view = self.run_view.group_views[group]
            topic = f"/world/{group}/control"
            applied = chunk.frames.get(topic)
            if applied is not None:
                yield from self._curves(agent, group_view, "control", topic, applied.times, applied.values[:, row])
            for name, topic in plotted(group_view):
                series = chunk.strips.get(topic)
                frames = chunk.frames.get(topic) if series is None else series.firsts
                if frames is None or not frames.values.shape[2]:
                    continue
                times, values = frames.times, frames.values[:, row]
                if isinstance(group_view.signals[name], Part):
                    yield from self._curves(agent, group_view, name, topic, times, values)
                else:
                    yield from self._by_unit(agent, topic, name, times, values)

    def _curves(
        self, agent: str, group_view: GroupView, field: str, topic: str, times: NDArray[np.int64], values: Array
    ) -> Iterator[Curves]:
        quantities = self.run_view.quantities_of(topic, field, values.shape[1])
        if field in group_view.signals and group_view.signals[field].drawn == "ellipse":
            quantities, values = _deviations(group_view, quantities, values)
        shown = [f"{name} [{unit}]" if unit not in ("", "1") else name for name, unit in quantities]
        yield from _curves(f"curves/agents/{agent}/{field}", times, shown, values)

    def _by_unit(self, agent: str, topic: str, field: str, times: NDArray[np.int64], values: Array) -> Iterator[Curves]:
        quantities = self.run_view.quantities_of(topic, field, values.shape[1])
        for path, columns in unit_paths(agent, topic, [unit for _, unit in quantities]).items():
            # Each path has a separate view, whose name contains the unit.
            yield from _curves(path, times, [quantities[column][0] for column in columns], values[:, columns])


def _curves(path: str, times: NDArray[np.int64], names: Sequence[str], values: Array) -> Iterator[Curves]:
    if names:
        colours = [AGENTS[number % len(AGENTS)] for number in range(len(names))]
        keep: Literal["greatest", "both"] = "greatest" if path.endswith("/risk") else "both"
        # A control input holds until the next one, as does a risk; a state and its uncertainty change gradually.
        holds = path.rpartition("/")[2] in ("control", "risk")
        given: dict[str, Any] = {"keep": keep, "stepwise": holds}
        yield Curves(path=path, times=times, values=values, names=names, colours=colours, **given)


class NumberTables(Drawing):
    """Makes tables of the numbers of all agents except paths, from which users choose what to plot."""

    outputs: ClassVar = frozenset({"foxglove"})
    order: ClassVar = 270

    def marks(self, chunk: Chunk) -> Iterator[Numbers]:
        """Yield a table for each topic of numbers."""
        for group_view in self.run_view.group_views.values():
            topics = [f"/world/{group_view.name}/{field}" for field in ("state", "control")]
            topics.append(f"/agents/{group_view.name}/control")
            topics += [group_view.topic(name) for name, signal in group_view.signals.items() if signal.drawn != "path"]
            for topic in topics:
                yield from self._numbers(topic, "value", group_view.agents, chunk)

    def _numbers(self, topic: str, field: str, names: Sequence[str], chunk: Chunk) -> Iterator[Numbers]:
        """Yield the table of a topic; unnamed columns get the name of the field."""
        series = chunk.strips.get(topic)
        frames = chunk.frames.get(topic) if series is None else series.firsts
        if frames is not None and len(frames.times):
            columns = self.run_view.quantities_of(topic, field, frames.values.shape[2])
            path = topic.strip("/")
            yield Numbers(path=path, times=frames.times, values=frames.values, names=names, columns=columns)


class RecordedNumbers(NumberTables):
    """Makes tables of all numbers in a chunk, including those of entities and the table signals of agents in focus."""

    outputs: ClassVar = frozenset({"plot"})
    order: ClassVar = 300

    def marks(self, chunk: Chunk) -> Iterator[Numbers]:
        """Yield a table for each topic."""
        for topic in sorted({*chunk.frames, *chunk.strips}):
            _, _, owner, *_, field = topic.split("/")
            view = self.run_view.group_views.get(owner)
            yield from self._numbers(topic, field, view.agents if view else [owner], chunk)
        for group_view in self.run_view.group_views.values():
            for name, signal in group_view.signals.items():
                if signal.kind == "table":
                    yield from self._entries(group_view, group_view.topic(name), chunk)

    def _entries(self, group_view: GroupView, topic: str, chunk: Chunk) -> Iterator[Numbers]:
        """Yield the concatenated entries of the tables of a signal."""
        names = [agent for agent in group_view.agents if agent in self.detail.focus]
        place = {group_view.agents.index(agent): number for number, agent in enumerate(names)}
        found = [
            (time, place[row], table)
            for time, message in chunk.entries.get(topic, ())
            for row, table in tables_of(message)
            if row in place and len(table)
        ]
        if found:
            sizes = [len(table) for _, _, table in found]
            entries = np.concatenate([table for _, _, table in found])
            values = np.full((len(entries), len(names), entries.shape[1]), np.nan)
            values[np.arange(len(entries)), np.repeat([number for _, number, _ in found], sizes)] = entries
            times = np.repeat(np.array([time for time, _, _ in found], np.int64), sizes)
            columns = self.run_view.quantities_of(topic, topic.rpartition("/")[2], entries.shape[1])
            path = topic.strip("/")
            yield Numbers(path=path, times=times, values=values, names=names, columns=columns, separate=True)


def plotted(group_view: GroupView) -> list[tuple[str, str]]:
    """Return the parts and signals with curves in an agent's tab, with their topics: all numbers except paths."""
    signals = group_view.signals.items()
    drawn = (name for name, signal in signals if signal.kind != "table" and signal.drawn not in (None, "path"))
    return [(name, group_view.topic(name)) for name in drawn]


def unit_paths(agent: str, topic: str, units: Sequence[str]) -> dict[str, list[int]]:
    """Return the paths at which the columns of a signal are drawn: one per unit, as scales may differ (m/s^2, rad/s).

    Args:
        agent: The id of the agent.
        topic: The topic of the signal.
        units: The units of its columns.

    Returns:
        The indices of columns, by path.
    """
    apart, place = list(dict.fromkeys(units)), topic.split("/", 3)[3]
    return {
        f"curves/agents/{agent}/{place}/{number}": [column for column, each in enumerate(units) if each == unit]
        for number, unit in enumerate(apart)
    }


def _deviations(
    group_view: GroupView, quantities: Sequence[tuple[str, str]], values: Array
) -> tuple[Sequence[tuple[str, str]], Array]:
    """Replace covariances by standard deviations, and omit samples, which are drawn as paths."""
    names = [name for name, _ in quantities]
    variances = [f"cov_{name}_{name}" for name, _ in group_view.state]
    if all(name in names for name in variances):
        deviations = np.sqrt(np.maximum(values[:, [names.index(name) for name in variances]], 0.0))
        return [(f"deviation of {name}", unit) for name, unit in group_view.state], deviations
    if any(re.fullmatch(r".+\.\d+", name) for name in names):
        return [], values
    return quantities, values
