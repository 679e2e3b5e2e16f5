"""What the agents in focus believe of others: ghosts where these are believed to be, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.viewing.beliefs import Beliefs, Reading
from symaware_cli.viewing.cast import in_space
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.drawing.minds import ellipsoids, fading, path_columns
from symaware_cli.viewing.excerpt import Excerpt
from symaware_cli.viewing.outline import circle
from symaware_cli.viewing.palette import faded

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

        cast, detail = self.cast, self.detail
        self._focus: dict[str, list[tuple[str, int]]] = {}
        for agent in detail.focus:
            group, row = cast.place[agent]
            self._focus.setdefault(group, []).append((agent, row))
        self._readings = {group: Reading(len(cast.troupes[group].position)) for group in self._focus}
        looks = [self._looks(name) for name in cast.roster]
        #: Of each in the roster.
        self._colours = np.array([colour for colour, _ in looks], np.uint8).reshape(-1, 3)
        self._radii = np.array([radius for _, radius in looks])
        self._heights = np.array([self._height(name) for name in cast.roster])
        thin, thick = rr.Radius.ui_points([1.0]), rr.Radius.ui_points([1.75])
        ghosts = rr.Cylinders3D.from_fields(lengths=[0.0], line_radii=thick, fill_mode="majorwireframe")
        doubts = rr.Ellipsoids3D.from_fields(line_radii=thin, fill_mode="majorwireframe")
        for group, agents in self._focus.items():
            reach = self.cast.troupes[group].perception_range
            for agent, _ in agents:
                self.stage.static(f"as/{agent}/others", ghosts)
                self.stage.static(f"as/{agent}/doubts", doubts)
                for name, _ in self.cast.troupes[group].drawn("path"):
                    self.stage.static(f"as/{agent}/{name}", rr.LineStrips3D.from_fields(radii=thick))
                # An eye follows only what there is something of.
                self.stage.static(f"as/{agent}/place", rr.Points3D([[0.0, 0.0, 0.0]], radii=rr.Radius.ui_points([0.0])))
                if reach:
                    colour = faded(np.array([180, 180, 190], np.uint8), 0.5)
                    ring = rr.LineStrips3D([in_space(circle(reach, corners=96))], colors=[colour], radii=thin)
                    self.stage.static(f"as/{agent}/place/range", ring)

    def draw(self, excerpt: Excerpt) -> None:
        """Draw what they believe."""
        for group, agents in self._focus.items():
            troupe = self.cast.troupes[group]
            frames = excerpt.frames.get(troupe.whereabouts)
            for agent, row in agents:
                if frames is not None:
                    places = troupe.positions(frames.values[:, row])
                    # What stands here moves along, and so does the eye that looks at it.
                    self.stage.poses(f"as/{agent}/place", frames.times, places)
                for name, topic in troupe.drawn("path"):
                    strips = excerpt.strips.get(topic)
                    if strips is not None:
                        columns = path_columns(troupe, name, strips)
                        fading(self.stage, f"as/{agent}/{name}", troupe, strips, [row], columns)
            entries = excerpt.entries.get(f"/agents/{group}/awareness")
            states = [(time, each) for time, each in entries or () if each.tells_states]
            if states:
                beliefs = self._readings[group].read(states, len(troupe.agents), [row for _, row in agents])
                for agent, row in agents:
                    self._draw(agent, row, beliefs)

    def _draw(self, agent: str, row: int, beliefs: Beliefs) -> None:
        times, counts, mine = beliefs.of(row)
        who = beliefs.who[mine]
        places = beliefs.places[mine] + self._heights[who, None] * np.array([0.0, 0.0, 1.0])
        colours, ages = self._colours[who], beliefs.ages[mine]
        if ages.any():
            colours = faded(colours, _LOSS * (1.0 - 0.5 ** (ages / _FADING)))
        self.stage.rings(f"as/{agent}/others", times, places, _RING * self._radii[who], counts, colours)
        if beliefs.covariances is not None:
            half_sizes, quaternions = ellipsoids(beliefs.covariances[mine])
            path = f"as/{agent}/doubts"
            self.stage.ellipsoids(path, times, places, half_sizes, quaternions, counts, faded(colours, 0.15))

    def _looks(self, name: str) -> tuple[Sequence[int], float]:
        """The colour of somebody and the radius [m]."""
        if name not in self.cast.place:
            return self.cast.props[name].colour, self.cast.props[name].shape.radius
        group, row = self.cast.place[name]
        troupe = self.cast.troupes[group]
        return troupe.colours[row].tolist(), troupe.extent or _POINT

    def _height(self, name: str) -> float:
        """At which height somebody is whose position is one in a plane [m]."""
        return self.cast.troupes[self.cast.place[name][0]].height if name in self.cast.place else 0.0
