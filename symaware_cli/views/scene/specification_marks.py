"""Specifications: bounds of the robustness over time, rings around agents that violate one, and a table."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import nanoseconds, seconds
from symaware_cli.log import begun_in, logged_events, verdicts_of
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.logged_events import LoggedEvent
from symaware_cli.views.chunk import Chunk
from symaware_cli.views.detail import Detail
from symaware_cli.views.palette import AGENTS, RISK, SATISFIED, UNDECIDED, VIOLATED, Colour
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Curves, Documents, Modes, Rings, Times
from symaware_cli.views.views import RunView

Array = NDArray[np.float64]

#: Radius of the ring around an agent that violates a specification, in radii of the body.
_REACH = 1.8


class SpecificationCurves(Drawing):
    """Draws a curve for each agent or pair: the upper bound of the robustness, and finally the robustness.

    Attributes:
        most: Maximum number of rows with a curve each; with more, only the least robustness is drawn; the
            verdicts have the number of violated rows.
    """

    outputs: ClassVar = frozenset({"replay"})
    order: ClassVar = 220

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
                values[number] = np.where(known == np.inf, np.nan, known)  # what has no bound yet
            names, colours = [" and ".join(agents) or name for agents in rows], self._colours(rows)
            if len(rows) > self.most:
                values, names, colours = np.fmin.reduce(values, axis=1)[:, None], [f"least of {len(rows)}"], [AGENTS[0]]
            yield Curves(
                path=f"curves/specifications/{name}",
                times=np.array([time for time, _ in told], np.int64),
                values=values,
                names=names,
                colours=colours,
                keep="least",
                level=("violated below", 0.0),
                stepwise=True,
            )

    def _colours(self, rows: Sequence[tuple[str, ...]]) -> list[Colour]:
        """Return a colour for each row: that of its agent, if it concerns only one."""
        found: list[Colour] = []
        for number, agents in enumerate(rows):
            own = AGENTS[number % len(AGENTS)]
            if len(agents) == 1 and agents[0] in self.run_view.place:
                group, row = self.run_view.place[agents[0]]
                red, green, blue = self.run_view.group_views[group].colours[row].tolist()
                own = red, green, blue
            found.append(own)
        return found


class VerdictStrips(Drawing):
    """Draws the verdict of each specification as its mode: undecided, satisfied or violated, or by how many agents."""

    outputs: ClassVar = frozenset({"replay", "plot"})
    order: ClassVar = 215

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._verdicts = {name: np.zeros(len(rows), np.int8) for name, rows in run_view.specifications.items()}
        self._told: dict[str, str] = {}

    def marks(self, chunk: Chunk) -> Iterator[Modes]:
        """Yield the changes of the verdict of each specification."""
        for name in self.run_view.specifications:
            changes: list[tuple[int, str]] = []
            for time, content in chunk.entries.get(f"/specifications/{name}", ()):
                rows, verdicts, _ = verdicts_of(content)
                if verdicts:
                    self._verdicts[name][slice(None) if rows is None else rows] = verdicts
                told = verdict_in_words(self._verdicts[name])
                if told != self._told.get(name):
                    self._told[name] = told
                    changes.append((time, told))
            if changes:
                yield Modes(
                    path=f"verdicts/{name}",
                    times=np.array([time for time, _ in changes], np.int64),
                    modes=[told for _, told in changes],
                    tints=_verdict_tints(len(self._verdicts[name])),
                )


def verdict_in_words(verdicts: NDArray[np.int8]) -> str:
    """Return the verdict on all rows (n,): violated if one is, with their number; else the number of satisfied ones."""
    violated, satisfied, count = int((verdicts < 0).sum()), int((verdicts > 0).sum()), len(verdicts)
    if count == 1:
        return "violated" if violated else "satisfied" if satisfied else "undecided"
    if violated:
        return f"{violated} of {count} violated"
    return "undecided" if not satisfied else "satisfied" if satisfied == count else f"{satisfied} of {count} satisfied"


def _verdict_tints(count: int) -> dict[str, Colour]:
    tints = {"undecided": UNDECIDED, "satisfied": SATISFIED, "violated": VIOLATED}
    for number in range(1, count + 1) if 1 < count <= _MOST else ():
        tints |= {f"{number} of {count} satisfied": SATISFIED, f"{number} of {count} violated": VIOLATED}
    return tints


class EverySpecificationCurve(SpecificationCurves):
    """Draws a curve for each agent or pair, however many there are."""

    outputs: ClassVar = frozenset({"plot"})
    order: ClassVar = 290

    most = sys.maxsize


class Violations(Drawing):
    """Draws a ring around each agent from when it violates a specification."""

    order: ClassVar = 190

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


#: Interval between two tables [ns], and the maximum number of their rows.
_STEP, _MOST = 100_000_000, 40
#: Number of characters of the longest bar. Rerun has no glyph for finer steps, or for bars outside of code.
_LONGEST = 16
_STATES = {1: "satisfied", -1: "**violated**", 0: "active"}
#: What the table says of the holder of an offered specification after an event of it.
_HOLDERS = {"offered": "(open)", "accepted": "{agent}", "released": "(open)", "rejected": "(rejected)"}


class SpecificationTable(Drawing):
    """Draws a table with a row for each specification.

    It has the upper bound of the robustness, the least of all rows, and a column for each signal that components record
    under the names of specifications, such as barrier functions: the least of all agents. If specifications are offered
    during the run, a column names the agent that holds each. The column `until` has the last instant that counts [s],
    once the specification is offered or has begun; of agents that enter the world later, the latest.
    """

    outputs: ClassVar = frozenset({"replay"})
    order: ClassVar = 230

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._names = list(run_view.specifications)[:_MOST]
        #: For each specification its state, and for each row an upper bound of the robustness and the verdict.
        self._states = dict.fromkeys(self._names, "")
        self._upper = {name: np.full(len(run_view.specifications[name]), np.nan) for name in self._names}
        self._begun = {name: np.zeros(len(run_view.specifications[name]), bool) for name in self._names}
        self._verdicts = {name: np.zeros(len(run_view.specifications[name]), np.int8) for name in self._names}
        #: For each signal, its topics with the column of each specification.
        self._signals: dict[str, list[tuple[str, Mapping[str, int]]]] = {}
        for group_view in run_view.group_views.values():
            for field, signal in group_view.signals.items():
                columns = {name: place for place, name in enumerate(signal.column_names) if name in self._upper}
                if columns and signal.kind == "vector":
                    self._signals.setdefault(signal.name, []).append((group_view.topic(field), columns))
        #: The agent that holds each offered specification; a text in parentheses if it is open, or was rejected.
        self._holders: dict[str, str] = {}
        #: The last instant that counts for each specification, where it is known [ns].
        self._until: dict[str, int] = {}
        self._next = 0

    def marks(self, chunk: Chunk) -> Iterator[Documents]:
        """Yield the tables of the instants of a chunk."""
        first = max(self._next, -(-chunk.start // _STEP))
        moments = np.arange(first, chunk.end // _STEP + 1, dtype=np.int64) * _STEP
        told: list[tuple[int, int, str, v1.Specification | LoggedEvent]] = [
            (time, place, name, content)
            for name in self._names
            for place, (time, content) in enumerate(chunk.entries.get(f"/specifications/{name}", ()))
        ]
        told += self._changes_of_holders(chunk)
        told.sort(key=lambda each: each[:3])
        recorded = {signal: self._recorded(topics, moments, chunk) for signal, topics in self._signals.items()}
        texts, taken = [], 0
        for place, moment in enumerate(moments.tolist()):
            while taken < len(told) and told[taken][0] <= moment:
                self._take(*told[taken])
                taken += 1
            texts.append(self._table({signal: values[place] for signal, values in recorded.items()}))
        for each in told[taken:]:
            self._take(*each)
        if texts and self._names:
            self._next = int(moments[-1] // _STEP) + 1
            yield Documents(path="specifications", times=moments, texts=texts)

    def _changes_of_holders(self, chunk: Chunk) -> Iterator[tuple[int, int, str, LoggedEvent]]:
        """Yield the events by which holders change: the time, the place, the specification, and the event."""
        for place, (time, message) in enumerate(chunk.entries.get("/events", ())):
            event = logged_events.event(time, message)
            name = event.source.removeprefix("specifications.")
            if name in self._upper and name != event.source and event.name in _HOLDERS:
                yield time, place, name, event

    def _take(self, time: int, _: int, name: str, content: v1.Specification | LoggedEvent) -> None:
        """Take note of a message of a specification, or of an event that tells who holds it."""
        if isinstance(content, LoggedEvent):
            self._holders[name] = _HOLDERS[content.name].format(agent=content.data.get("agent", ""))
            if content.name == "offered":
                self._until[name] = self._end(name, nanoseconds(float(content.data.get("from", 0.0))))
            return
        rows, verdicts, upper = verdicts_of(content)
        chosen = slice(None) if rows is None else rows
        if len(verdicts):
            begun = np.array(begun_in(content), bool)
            if (begun & ~self._begun[name][chosen]).any() and name not in self._holders:
                self._until[name] = self._end(name, time)
            self._verdicts[name][chosen], self._begun[name][chosen] = verdicts, begun
            counted = self._verdicts[name][self._begun[name]]
            self._states[name] = _STATES[int(counted.min())] if len(counted) else ""
        if len(upper):
            self._upper[name][chosen] = upper

    def _end(self, name: str, begin: int) -> int:
        """Return the last instant that counts for a specification which begins at an instant [ns]."""
        horizon, end = self.run_view.spans.get(name, (None, None))
        ends = [nanoseconds(self.run_view.duration), begin + horizon if horizon is not None else None, end]
        return min(each for each in ends if each is not None)

    def _recorded(self, topics: Sequence[tuple[str, Mapping[str, int]]], moments: Times, chunk: Chunk) -> Array:
        """Return the least value of all agents for each specification; (k, specifications), NaN where unknown."""
        found = np.full((len(moments), len(self._names)), np.nan)
        for topic, columns in topics:
            frames = chunk.frames.get(topic)
            if frames is not None:
                values = np.fmin.reduce(frames.at(moments), axis=1)
                for number, name in enumerate(self._names):
                    if name in columns:
                        found[:, number] = np.fmin(found[:, number], values[:, columns[name]])
        return found

    def _table(self, recorded: Mapping[str, Array]) -> str:
        least = [np.fmin.reduce(self._upper[name][self._begun[name]], initial=np.inf) for name in self._names]
        columns = {"robustness": np.array(least, float), **recorded}
        bars = [_bars(np.where(values == np.inf, np.nan, values)) for values in columns.values()]
        held = bool(self._holders)
        lines = [
            f"| specification |{' held by |' * held} | until [s] | {' | | '.join(columns)} | |",
            f"|---|{'---|' * held}---|--:|" + "--:|:--|" * len(columns),
        ]
        for number, name in enumerate(self._names):
            cells = [cell for column in bars for cell in column[number]]
            holder = f" {self._holders.get(name, '')} |" * held
            until = f"{seconds(self._until[name]):g}" if name in self._until else ""
            lines.append(f"| {name} |{holder} {self._states[name]} | {until} | {' | '.join(cells)} |")
        return "\n".join(lines)


def _bars(values: Array) -> list[tuple[str, str]]:
    """Return each number with its bar, relative to the greatest of them; no bar for unknown or negative ones."""
    greatest = float(np.fmax.reduce(values, initial=0.0))
    cells = []
    for value in values.tolist():
        length = round(_LONGEST * max(value, 0.0) / greatest) if greatest > 0.0 and value == value else 0
        cells.append((f"{value:.3f}" if value == value else "", f"`{'█' * length}`" if length else ""))
    return cells
