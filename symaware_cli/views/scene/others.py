"""Beliefs of the agents in focus about others: rings at believed positions, ellipses, intents and regions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import others_message, row_position
from symaware_cli.views.chunk import Chunk
from symaware_cli.views.detail import Detail
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Ellipsoids, FocusPoint, Lines, Mark, Rings
from symaware_cli.views.scene.own_awareness import ellipsoids, path_columns, ways
from symaware_cli.views.views import RunView, in_space

Array = NDArray[np.float64]
Integers = NDArray[np.intp]


@dataclass(frozen=True)
class Beliefs:
    """Beliefs of the agents of one group, ordered by message and observer.

    Attributes:
        times: (k,) of the messages [ns].
        told: (k, n) which agents each message covers; it contains all beliefs of these agents.
        message: (m,) index of the message of each belief.
        observer: (m,) row in the group of the agent that believes.
        who: (m,) roster index of the agent that the belief is about.
        places: (m, 3) believed position [m].
        covariances: (m, d, d) of the position [m^2], NaN where unknown; None if it is unknown for all.
        ages: (m,) age of the belief [s].
    """

    times: NDArray[np.int64]
    told: NDArray[np.bool_]
    message: Integers
    observer: Integers
    who: Integers
    places: Array
    covariances: Array | None
    ages: Array

    def of(self, row: int) -> tuple[NDArray[np.int64], Integers, NDArray[np.intp]]:
        """Return the beliefs of one agent.

        Returns:
            The times of the messages that cover it (j,) [ns], the number of beliefs in each (j,), and the indices of
            these beliefs.
        """
        telling, mine = self.told[:, row], np.flatnonzero(self.observer == row)
        counts = np.bincount(self.message[mine], minlength=len(self.times))
        return self.times[telling], counts[telling], mine


def read_beliefs(
    entries: Sequence[tuple[int, others_message.Awareness]], count: int, wanted: Sequence[int], dimension: int
) -> Beliefs:
    """Read the messages of one group.

    Args:
        entries: The time [ns] and content of each; agents that know the whole world have no beliefs besides it.
        count: How many agents the group has.
        wanted: The agents whose beliefs are read, as rows of the group.
        dimension: In how many dimensions they move; a belief begins with the position.
    """
    times = np.array([time for time, _ in entries], np.int64)
    told = np.zeros((len(entries), count), bool)
    for number, (_, message) in enumerate(entries):
        told[number, slice(None) if message.rows is None else message.rows] = True
    known = [(number * count, message) for number, (_, message) in enumerate(entries) if len(message.entities)]
    everyone = np.array(wanted)[None] + count * np.arange(len(entries))[:, None]
    others = _joined(known, count).others(count, dimension, everyone)
    return Beliefs(
        times=times,
        told=told,
        message=others.rows // count,
        observer=others.rows % count,
        who=others.entities,
        places=in_space(others.values),
        covariances=others.covariances,
        ages=others.ages,
    )


def _joined(entries: Sequence[tuple[int, others_message.Awareness]], count: int) -> others_message.Awareness:
    """Join messages into one; rows are counted from a first row that is given with each."""
    rows, lengths, columns = [], [], []
    for first, message in entries:
        here = np.arange(count) if message.rows is None else message.rows
        rows.append(first + here)
        lengths.append(np.broadcast_to(message.lengths, len(here)))
        columns.append(np.broadcast_to(message.columns, len(message.entities)))
    messages = [message for _, message in entries]
    # Zeros stand for covariances and ages that a message does not have.
    squares = [np.zeros(int((each.astype(np.int64) ** 2).sum())) for each in columns]
    spreads = [
        each.covariances if len(each.covariances) else zero for each, zero in zip(messages, squares, strict=True)
    ]
    whole: dict[str, Any] = {"rows": rows, "lengths": lengths, "columns": columns}
    whole |= {"entities": [each.entities for each in messages], "values": [each.values for each in messages]}
    whole["ages"] = [each.ages if len(each.ages) else np.zeros(len(each.entities)) for each in messages]
    whole["covariances"] = spreads if any(len(each.covariances) for each in messages) else []
    nothing = np.empty(0, np.int64)
    given: Any = {name: np.concatenate([nothing, *parts]) for name, parts in whole.items()}
    return others_message.Awareness(world=False, **given)


#: Half-life of a belief's fading with age [s], and its maximum transparency.
_FADING = 1.0
_LOSS = 0.55
#: Diameter of the ring for an agent without a body [m].
_POINT = 0.2
#: Rings are a little wider than the body, so that both are visible where they coincide.
_RING = 1.3
#: The part of awareness that consists of regions.
_REGION = "region"
#: Widths of lines [pixels].
_THIN, _THICK = 1.0, 1.75


class BeliefsAboutOthers(Drawing):
    """Draws the world as each agent in focus believes it to be, at the path as/<agent>."""

    order: ClassVar = 90

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        """Collect the agents in focus, and the colours and sizes of others."""
        super().__init__(run_view, detail)
        self._focus: dict[str, list[tuple[str, int]]] = {}
        for agent in detail.focus:
            group, row = run_view.place[agent]
            self._focus.setdefault(group, []).append((agent, row))
        looks = [self._appearance(name) for name in run_view.roster]
        #: For each index in the roster.
        self._colours = np.array([colour for colour, _ in looks], np.uint8).reshape(-1, 3)
        self._radii = np.array([radius for _, radius in looks])
        self._heights = np.array([self._height(name) for name in run_view.roster])
        #: The parts of awareness, of any group, that are drawn as paths.
        self._paths = sorted({name for view in run_view.group_views.values() for name, _ in view.drawn("path")})

    def marks(self, chunk: Chunk) -> Iterator[Mark]:
        """Yield the beliefs of the agents in focus, and their own intents."""
        for group, agents in self._focus.items():
            group_view = self.run_view.group_views[group]
            frames = chunk.frames.get(group_view.state_topic)
            for agent, row in agents:
                times, places = np.empty(0, np.int64), np.empty((0, 3))
                if frames is not None:
                    times, places = frames.times, group_view.positions(frames.values[:, row])
                reach = group_view.perception_range
                yield FocusPoint(path=f"as/{agent}/place", times=times, positions=places, reach=reach)
                for name, topic in group_view.drawn("path"):
                    series = chunk.strips.get(topic)
                    if series is not None:
                        yield from ways(f"as/{agent}/{name}", "", group_view, name, series, [row], _THICK)
            entries = chunk.entries.get(f"/agents/{group}/awareness", ())
            for name in self._paths:
                for agent, row in agents:
                    yield from self._intents(name, agent, row, entries)
            for agent, row in agents:
                yield from self._regions(agent, row, entries)
            states = [(time, each) for time, each in entries if each.has_states]
            if states:
                rows, dimension = [row for _, row in agents], len(group_view.position)
                beliefs = read_beliefs(states, len(group_view.agents), rows, dimension)
                for agent, row in agents:
                    yield from self._beliefs(agent, row, beliefs)

    def _beliefs(self, agent: str, row: int, beliefs: Beliefs) -> Iterator[Rings | Ellipsoids]:
        times, counts, mine = beliefs.of(row)
        who = beliefs.who[mine]
        centres = beliefs.places[mine] + self._heights[who, None] * np.array([0.0, 0.0, 1.0])
        ages = beliefs.ages[mine]
        # Beliefs fade with age.
        given: dict[str, Any] = {"times": times, "counts": counts, "centres": centres, "names": self.run_view.roster}
        given |= {"who": who, "transparency": _LOSS * (1.0 - 0.5 ** (ages / _FADING))}
        colours, radii = self._colours[who], _RING * self._radii[who]
        yield Rings(path=f"as/{agent}/others", radii=radii, colours=colours, width=_THICK, **given)
        if beliefs.covariances is not None:
            half_sizes, orientations = ellipsoids(beliefs.covariances[mine])
            given |= {"half_sizes": half_sizes, "orientations": orientations, "width": _THIN}
            given["transparency"] = 1.0 - 0.85 * (1.0 - given["transparency"])
            yield Ellipsoids(path=f"as/{agent}/uncertainties", colours=colours, **given)

    def _intents(
        self, part: str, agent: str, row: int, entries: Sequence[tuple[int, others_message.Awareness]]
    ) -> Iterator[Lines]:
        """Yield the intended paths of others, as believed by an agent."""
        times, counts = [], []
        lines: list[Array] = []
        owners: list[int] = []
        for time, message in entries:
            for told in message.series:
                place = row_position(row, told.rows)
                if told.part != part or place is None:
                    continue
                before = len(lines)
                for whose, who, _, values in told:
                    points = self._way(part, who, values) if whose == place else None
                    if points is not None:
                        lines.append(points)
                        owners.append(who)
                times.append(time)
                counts.append(len(lines) - before)
        if times:
            yield Lines(
                path=f"as/{agent}/others/{part}",
                times=np.array(times, np.int64),
                counts=counts,
                points=np.concatenate([np.empty((0, 3)), *lines]),
                lengths=[len(line) for line in lines],
                colours=self._colours[owners],
                names=self.run_view.roster,
                who=np.array(owners, np.intp),
                width=_THIN,
                fades=True,
            )

    def _regions(
        self, agent: str, row: int, entries: Sequence[tuple[int, others_message.Awareness]]
    ) -> Iterator[Rings]:
        """Yield the regions in which an agent expects others, fainter the later; see `uncertainty.conformal`."""
        times, counts = [], []
        places: list[Array] = []
        owners: list[int] = []
        for time, message in entries:
            for told in message.series:
                place = row_position(row, told.rows)
                if told.part != _REGION or place is None:
                    continue
                before = len(owners)
                for whose, who, _, values in told:
                    if whose == place and len(values) > 1:
                        # The first is where the other is now; after the centre come radius and coverage.
                        centres = in_space(values[1:, :-2], self._heights[who])
                        faintness = np.linspace(0.3, 0.8, len(centres))
                        places.append(np.column_stack([centres, values[1:, -2], faintness]))
                        owners += [who] * len(centres)
                times.append(time)
                counts.append(len(owners) - before)
        if times:
            circles = np.concatenate([np.empty((0, 5)), *places])
            yield Rings(
                path=f"as/{agent}/others/{_REGION}",
                times=np.array(times, np.int64),
                counts=counts,
                centres=circles[:, :3],
                radii=circles[:, 3],
                transparency=circles[:, 4],
                colours=self._colours[owners],
                names=self.run_view.roster,
                who=np.array(owners, np.intp),
                width=_THIN,
            )

    def _way(self, part: str, who: int, values: Array) -> Array | None:
        """Return the points of the path of an agent in the roster, (k, 3); None if there is none."""
        place = self.run_view.place.get(self.run_view.roster[who])
        if place is None or len(values) < 2:
            return None
        group_view = self.run_view.group_views[place[0]]
        is_path = part in group_view.signals and group_view.signals[part].drawn == "path"
        columns = path_columns(group_view, part, values.shape[1]) if is_path else None
        return None if columns is None else in_space(values[:, columns], group_view.height)

    def _appearance(self, name: str) -> tuple[Sequence[int], float]:
        """Return the colour and the radius [m] of an agent or entity."""
        if name not in self.run_view.place:
            return self.run_view.obstacle_views[name].colour, self.run_view.obstacle_views[name].shape.radius
        group, row = self.run_view.place[name]
        group_view = self.run_view.group_views[group]
        return group_view.colours[row].tolist(), group_view.extent or _POINT

    def _height(self, name: str) -> float:
        """Return the height of an agent whose position is two-dimensional [m]."""
        return self.run_view.group_views[self.run_view.place[name][0]].height if name in self.run_view.place else 0.0
