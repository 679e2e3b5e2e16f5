"""What the agents in focus believe of others: ghosts where these are believed to be, and how sure that is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording import wire
from symaware_cli.recording.series import row_position
from symaware_cli.viewing.beliefs import Beliefs, read_beliefs
from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.scene.base import Drawing
from symaware_cli.viewing.scene.intents import path_columns, ways
from symaware_cli.viewing.scene.marks import Ellipsoids, FocusPoint, Lines, Mark, Rings
from symaware_cli.viewing.scene.uncertainties import ellipsoids
from symaware_cli.viewing.views import RunView, in_space

Array = NDArray[np.float64]

#: The age at which a belief has lost half of what it loses of its strength at most [s], and how much that is.
_FADING = 1.0
_LOSS = 0.55
#: How big a ghost without a body is [m].
_POINT = 0.2
#: A ghost is a ring just wider than the body, so that both are seen where they coincide.
_RING = 1.3
#: How thick lines are [pixels].
_THIN, _THICK = 1.0, 1.75


class Others(Drawing):
    """The world as each agent in focus believes it to be, in a place of its own: as/<agent>."""

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        """Look up who is in focus, and what others look like."""
        super().__init__(run_view, detail)
        self._focus: dict[str, list[tuple[str, int]]] = {}
        for agent in detail.focus:
            group, row = run_view.place[agent]
            self._focus.setdefault(group, []).append((agent, row))
        looks = [self._looks(name) for name in run_view.roster]
        #: Of each in the roster.
        self._colours = np.array([colour for colour, _ in looks], np.uint8).reshape(-1, 3)
        self._radii = np.array([radius for _, radius in looks])
        self._heights = np.array([self._height(name) for name in run_view.roster])
        #: The parts of awareness that are ways ahead, of any group.
        self._paths = sorted({name for view in run_view.group_views.values() for name, _ in view.drawn("path")})

    def marks(self, chunk: Chunk) -> Iterator[Mark]:
        """What they believe, and what they mean to do themselves."""
        for group, agents in self._focus.items():
            group_view = self.run_view.group_views[group]
            frames = chunk.frames.get(group_view.whereabouts)
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
                    yield from self._ways(name, agent, row, entries)
            states = [(time, each) for time, each in entries if each.has_states]
            if states:
                rows, dimension = [row for _, row in agents], len(group_view.position)
                beliefs = read_beliefs(states, len(group_view.agents), rows, dimension)
                for agent, row in agents:
                    yield from self._ghosts(agent, row, beliefs)

    def _ghosts(self, agent: str, row: int, beliefs: Beliefs) -> Iterator[Rings | Ellipsoids]:
        times, counts, mine = beliefs.of(row)
        who = beliefs.who[mine]
        centres = beliefs.places[mine] + self._heights[who, None] * np.array([0.0, 0.0, 1.0])
        ages = beliefs.ages[mine]
        # The older, the fainter.
        given: dict[str, Any] = {"times": times, "counts": counts, "centres": centres, "names": self.run_view.roster}
        given |= {"who": who, "transparency": _LOSS * (1.0 - 0.5 ** (ages / _FADING))}
        colours, radii = self._colours[who], _RING * self._radii[who]
        yield Rings(path=f"as/{agent}/others", radii=radii, colours=colours, width=_THICK, **given)
        if beliefs.covariances is not None:
            half_sizes, orientations = ellipsoids(beliefs.covariances[mine])
            given |= {"half_sizes": half_sizes, "orientations": orientations, "width": _THIN}
            given["transparency"] = 1.0 - 0.85 * (1.0 - given["transparency"])
            yield Ellipsoids(path=f"as/{agent}/doubts", colours=colours, **given)

    def _ways(self, part: str, agent: str, row: int, entries: Sequence[tuple[int, wire.Awareness]]) -> Iterator[Lines]:
        """The ways that others mean to go, as far as an agent knows them."""
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

    def _way(self, part: str, who: int, values: Array) -> Array | None:
        """The points of a way of somebody in the roster, (k, 3); None where it is none."""
        place = self.run_view.place.get(self.run_view.roster[who])
        if place is None or len(values) < 2:
            return None
        group_view = self.run_view.group_views[place[0]]
        is_path = part in group_view.signals and group_view.signals[part].drawn == "path"
        columns = path_columns(group_view, part, values.shape[1]) if is_path else None
        return None if columns is None else in_space(values[:, columns], group_view.height)

    def _looks(self, name: str) -> tuple[Sequence[int], float]:
        """The colour of somebody and the radius [m]."""
        if name not in self.run_view.place:
            return self.run_view.obstacle_views[name].colour, self.run_view.obstacle_views[name].shape.radius
        group, row = self.run_view.place[name]
        group_view = self.run_view.group_views[group]
        return group_view.colours[row].tolist(), group_view.extent or _POINT

    def _height(self, name: str) -> float:
        """At which height somebody is whose position is one in a plane [m]."""
        return self.run_view.group_views[self.run_view.place[name][0]].height if name in self.run_view.place else 0.0
