"""What the agents in focus believe of others: ghosts where these are believed to be, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording import wire
from symaware_cli.recording.series import place_of
from symaware_cli.viewing.beliefs import Beliefs, Reading
from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.drawing.intents import ellipsoids, fading, fading_line, path_columns
from symaware_cli.viewing.outline import circle
from symaware_cli.viewing.palette import faded
from symaware_cli.viewing.views import in_space

Array = NDArray[np.float64]

#: The age at which a belief has lost half of what it loses of its strength at most [s], and how much that is.
_FADING = 1.0
_LOSS = 0.55
#: How big a ghost without a body is [m].
_POINT = 0.2
#: A ghost is a ring just wider than the body, so that both are seen where they coincide.
_RING = 1.3


class Others(Drawing):
    """The world as each agent in focus believes it to be, in a place of its own: as/<agent>."""

    def begin(self) -> None:
        """Look up who is in focus; put up how far they see, and how thick lines are."""
        import rerun as rr

        run_view, detail = self.run_view, self.detail
        self._focus: dict[str, list[tuple[str, int]]] = {}
        for agent in detail.focus:
            group, row = run_view.place[agent]
            self._focus.setdefault(group, []).append((agent, row))
        self._readings = {group: Reading(len(run_view.group_views[group].position)) for group in self._focus}
        looks = [self._looks(name) for name in run_view.roster]
        #: Of each in the roster.
        self._colours = np.array([colour for colour, _ in looks], np.uint8).reshape(-1, 3)
        self._radii = np.array([radius for _, radius in looks])
        self._heights = np.array([self._height(name) for name in run_view.roster])
        #: The parts of awareness that are ways ahead, of any group.
        self._paths = sorted({name for view in run_view.group_views.values() for name, _ in view.drawn("path")})
        thin, thick = rr.Radius.ui_points([1.0]), rr.Radius.ui_points([1.75])
        ghosts = rr.Cylinders3D.from_fields(lengths=[0.0], line_radii=thick, fill_mode="majorwireframe")
        doubts = rr.Ellipsoids3D.from_fields(line_radii=thin, fill_mode="majorwireframe")
        for group, agents in self._focus.items():
            reach = self.run_view.group_views[group].perception_range
            for agent, _ in agents:
                self.output.static(f"as/{agent}/others", ghosts)
                self.output.static(f"as/{agent}/doubts", doubts)
                for name, _ in self.run_view.group_views[group].drawn("path"):
                    self.output.static(f"as/{agent}/{name}", rr.LineStrips3D.from_fields(radii=thick))
                for name in self._paths:
                    self.output.static(f"as/{agent}/others/{name}", rr.LineStrips3D.from_fields(radii=thin))
                # An eye follows only what there is something of.
                self.output.static(
                    f"as/{agent}/place", rr.Points3D([[0.0, 0.0, 0.0]], radii=rr.Radius.ui_points([0.0]))
                )
                if reach:
                    colour = faded(np.array([180, 180, 190], np.uint8), 0.5)
                    ring = rr.LineStrips3D([in_space(circle(reach, corners=96))], colors=[colour], radii=thin)
                    self.output.static(f"as/{agent}/place/range", ring)

    def draw(self, chunk: Chunk) -> None:
        """Draw what they believe."""
        for group, agents in self._focus.items():
            group_view = self.run_view.group_views[group]
            frames = chunk.frames.get(group_view.whereabouts)
            for agent, row in agents:
                if frames is not None:
                    places = group_view.positions(frames.values[:, row])
                    # What stands here moves along, and so does the eye that looks at it.
                    self.output.poses(f"as/{agent}/place", frames.times, places)
                for name, topic in group_view.drawn("path"):
                    strips = chunk.strips.get(topic)
                    if strips is not None:
                        columns = path_columns(group_view, name, strips.values.shape[1])
                        fading(self.output, f"as/{agent}/{name}", group_view, strips, [row], columns)
            entries = chunk.entries.get(f"/agents/{group}/awareness", ())
            for name in self._paths:
                for agent, row in agents:
                    self._draw_ways(name, agent, row, entries)
            states = [(time, each) for time, each in entries if each.tells_states]
            if states:
                beliefs = self._readings[group].read(states, len(group_view.agents), [row for _, row in agents])
                for agent, row in agents:
                    self._draw(agent, row, beliefs)

    def _draw(self, agent: str, row: int, beliefs: Beliefs) -> None:
        times, counts, mine = beliefs.of(row)
        who = beliefs.who[mine]
        places = beliefs.places[mine] + self._heights[who, None] * np.array([0.0, 0.0, 1.0])
        colours, ages = self._colours[who], beliefs.ages[mine]
        if ages.any():
            colours = faded(colours, _LOSS * (1.0 - 0.5 ** (ages / _FADING)))
        self.output.rings(f"as/{agent}/others", times, places, _RING * self._radii[who], counts, colours)
        if beliefs.covariances is not None:
            half_sizes, quaternions = ellipsoids(beliefs.covariances[mine])
            path = f"as/{agent}/doubts"
            self.output.ellipsoids(path, times, places, half_sizes, quaternions, counts, faded(colours, 0.15))

    def _draw_ways(self, part: str, agent: str, row: int, entries: Sequence[tuple[int, wire.Awareness]]) -> None:
        """Draw the ways that others mean to go, as far as an agent knows them."""
        times, counts, lines = [], [], []
        colours: list[NDArray[np.uint8]] = []
        for time, message in entries:
            for told in message.series:
                place = place_of(row, told.rows)
                if told.part != part or place is None:
                    continue
                before = len(colours)
                for whose, who, _, values in told:
                    points = self._way(part, who, values) if whose == place else None
                    if points is not None:
                        line, shades = fading_line(points, self._colours[who])
                        lines.append(line)
                        colours.extend(shades)
                times.append(time)
                counts.append(len(colours) - before)
        if times:
            points = np.concatenate(lines) if lines else np.empty((0, 3))
            shown = np.array(colours, np.uint8).reshape(-1, 3)
            at = np.array(times, np.int64)
            self.output.strips(f"as/{agent}/others/{part}", at, points, np.full(len(shown), 2), counts, shown)

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
