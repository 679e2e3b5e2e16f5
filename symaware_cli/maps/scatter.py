"""Random fields of obstacles that leave room for agents and their goals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator

from symaware_cli.core import Obstacle
from symaware_cli.geometry import LARGEST, Array, Number, RegionShape, Scenery
from symaware_cli.geometry.shape import Shape
from symaware_cli.language import InitialAgents, Section, positions_in
from symaware_cli.maps.floor import FloorPart
from symaware_cli.maps.map_error import MapError
from symaware_cli.world import GroupChance, agent_numbers

#: The greatest number of draws of a place for an obstacle.
_TRIES = 1000

#: The knowledge of agents that names the places they are to go to.
_GOALS = ("goal", "waypoints")

Distance = Annotated[float, Field(ge=0, le=LARGEST)]


class Scatter(Section):
    """A random field of obstacles of one shape."""

    count: int = Field(ge=1, le=2000, description="Number of obstacles.")
    shape: Shape = Field(description="Outline of the obstacles: a circle, box, cylinder or polygon, turned at random.")
    apart: Distance = Field(
        0.5,
        description="Least distance between the circles around two of them, and from other bodies of the world [m].",
    )
    clear: Distance = Field(
        0.5, description="Least distance of such circles from those around agents at their starts and goals [m]."
    )
    within: tuple[Number, Number, Number, Number] | None = Field(
        None, description="Area of their centres: [x, x, y, y] [m]. By default the extent of the map's file."
    )

    @field_validator("shape")
    @classmethod
    def _is_plain(cls, shape: Shape) -> Shape:
        if shape.wall or shape.mesh or shape.urdf:
            raise ValueError(f"a {shape.kind} cannot be scattered; take a circle, box, cylinder or polygon")
        return shape

    @field_validator("within")
    @classmethod
    def _is_area(cls, within: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if within is not None and (within[0] >= within[1] or within[2] >= within[3]):
            raise ValueError("the least of a coordinate is not below its greatest")
        return within


def scattered(
    scatter: Scatter,
    within: tuple[float, float, float, float],
    seed: int,
    agents: Sequence[InitialAgents],
    others: Mapping[str, Obstacle],
) -> FloorPart:
    """Draw a field of obstacles.

    Places are drawn uniformly, obstacle by obstacle, until the obstacle has room. The draws are keyed by the seed, the
    number of the obstacle and that of the attempt, so one more obstacle does not move the others.

    Args:
        scatter: The description.
        within: The area of the centres: [x, x, y, y] [m].
        seed: The seed of the run.
        agents: The agents, whose starts and goals stay free.
        others: The other bodies of the world, at their initial poses.

    Raises:
        MapError: There is no room for all obstacles.
    """
    radius, count = scatter.shape.radius, scatter.count
    low, high = np.array([within[0], within[2]]), np.array([within[1], within[3]])
    kept, distances = _kept_free(agents)
    scenery = Scenery(others)
    numbers = agent_numbers(f"scatter_{number}" for number in range(count))
    places, headings = np.empty((0, 2)), np.empty(count)
    drawn: list[Array] = []
    for number in range(count):
        for attempt in range(_TRIES):
            if attempt == len(drawn):
                drawn.append(GroupChance(seed, f"scenario map.scatter.{attempt}", numbers).uniform(3))
            place = low + drawn[attempt][number, :2] * (high - low)
            if (
                _is_farther(place, kept, distances + radius + scatter.clear)
                and _is_farther(place, places, np.full(len(places), 2.0 * radius + scatter.apart))
                and not len(scenery.nearest(place[None], radius + scatter.apart).row)
            ):
                places = np.concatenate([places, place[None]])
                headings[number] = 2.0 * np.pi * drawn[attempt][number, 2]
                break
        else:
            raise MapError(
                f"{number} of {count} obstacles have room, and no place was found for another in {_TRIES} draws; "
                "take fewer, smaller or closer ones, or a larger area"
            )
    bodies = {
        f"scatter_{number}": Obstacle(
            shape=scatter.shape, position=tuple(place), heading=0.0 if scatter.shape.kind == "circle" else heading
        )
        for number, (place, heading) in enumerate(zip(places.tolist(), headings.tolist(), strict=True))
    }
    areas = [_area(body) for body in bodies.values()]
    return FloorPart(bodies, areas)


def _is_farther(place: Array, others: Array, least: Array) -> bool:
    away = others - place
    return bool((away[:, 0] ** 2 + away[:, 1] ** 2 >= least * least).all())


def _kept_free(agents: Sequence[InitialAgents]) -> tuple[Array, Array]:
    """Return the starts and goals of all agents, (m, 2), and the radii of their bodies, (m,) [m]."""
    places, radii = [np.empty((0, 2))], [np.empty(0)]
    for group in agents:
        goals = [place for name in _GOALS for known in group.known(name) for place in positions_in(known)]
        found = np.concatenate([group.positions[:, :2], np.array(goals).reshape(-1, 2)])
        found = found[np.isfinite(found).all(axis=1)]  # agents without a position are placed later
        places.append(found)
        radii.append(np.full(len(found), group.radius))
    return np.concatenate(places), np.concatenate(radii)


def _area(body: Obstacle) -> RegionShape:
    """Return the area of a body."""
    ((core, rounding),) = body.shape.pieces
    x, y = (body.position or (0.0, 0.0))[:2]
    if len(core) == 1:
        return RegionShape.model_validate({"circle": {"centre": (x, y), "radius": rounding}})
    cosine, sine = float(np.cos(body.heading)), float(np.sin(body.heading))
    corners = tuple((x + cosine * a - sine * b, y + sine * a + cosine * b) for a, b in core)
    return RegionShape(polygon=corners)
