"""Starts and goals of agents, drawn uniformly from positions without contact.

Reasons: docs/decisions/0097-starts-in-free-space.md
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from symaware_cli.geometry import LARGEST, Number, Scenery
from symaware_cli.language.problem import quoted
from symaware_cli.language.section import Section
from symaware_cli.language.source import Path
from symaware_cli.world import GroupChance, agent_numbers

if TYPE_CHECKING:
    from symaware_cli.core import Obstacle
    from symaware_cli.geometry import Region, RegionShape
    from symaware_cli.language.scenario_section import InitialAgents
    from symaware_cli.specification import PlacedRegion

Array = NDArray[np.float64]
#: The least and greatest of both coordinates [m]: [x, x, y, y].
Bounds = tuple[float, float, float, float]
Distance = Annotated[float, Field(ge=0, le=LARGEST)]

#: The name of the form.
FREE = "free"

#: The greatest number of draws of a place for an agent.
_TRIES = 1000


def _is_area(within: str | Bounds | None) -> str | Bounds | None:
    if isinstance(within, tuple) and (within[0] >= within[1] or within[2] >= within[3]):
        raise ValueError("the least of a coordinate is not below its greatest")
    return within


class FreePlacement(Section):
    """Positions drawn uniformly where bodies touch no obstacle, apart from each other; others for each seed."""

    apart: Distance = Field(
        0.5,
        description="Least distance between the circles around the bodies of two agents there: at their starts, or at "
        "places that they know under the same name [m].",
    )
    clear: Distance = Field(0.2, description="Least distance of such a circle from the obstacles [m].")
    within: Annotated[str | tuple[Number, Number, Number, Number] | None, AfterValidator(_is_area)] = Field(
        None,
        description="Area of their centres: [x, x, y, y] [m], or the name of a region. By default the map.",
    )
    outside: tuple[str, ...] = Field((), description="Names of regions from which the circles are `clear`, too.")
    heading: Number | Literal["any"] = Field(
        "any", description="Heading of all agents [rad], for models that have one; by default each is drawn."
    )
    height: Number | None = Field(None, description="The third coordinate of their positions [m].")


class PlacementError(ValueError):
    """Agents cannot be placed; the message continues "the agents cannot be placed: "."""


class Places(ABC):
    """Determines the places of the agents of one group that a scenario places in the free space."""

    @abstractmethod
    def poses(self, placement: FreePlacement, path: Path, purpose: str, rows: Sequence[int]) -> tuple[Array, Array]:
        """Return the positions [m] and headings [rad] of agents; shapes (n, d) and (n,).

        Args:
            placement: The description.
            path: The path of the initial state or value of knowledge that contains the placement.
            purpose: The key of the draws, besides the seed and the agent.
            rows: The numbers of the agents.

        Raises:
            PlacementError: There is no room for all agents.
        """


class Unplaced(Places):
    """A stand-in for places that are not known yet.

    Attributes:
        coordinate: The coordinates of all places: NaN, or a number.
    """

    def __init__(self, coordinate: float) -> None:
        self.coordinate = coordinate

    def poses(self, placement: FreePlacement, path: Path, purpose: str, rows: Sequence[int]) -> tuple[Array, Array]:
        """Return the same place for all agents."""
        columns = 2 if placement.height is None else 3
        return np.full((len(rows), columns), self.coordinate), np.zeros(len(rows))


class FreeRoom:
    """The space between bodies, and the places in it that have been taken.

    Starts keep apart from starts, and goals from goals, but not starts from goals: an agent may start at another's
    goal.
    """

    def __init__(
        self,
        seed: int,
        obstacles: Mapping[str, Obstacle],
        regions: Mapping[str, Region],
        bounds: Bounds | None,
        free: Sequence[str],
        agents: Sequence[InitialAgents],
    ) -> None:
        """Place the obstacles at their initial poses, and the agents whose places are given.

        Args:
            seed: The seed of the run.
            obstacles: The bodies of the world.
            regions: The regions, by name.
            bounds: The area of the map; None without one.
            free: The names of regions in which all places lie.
            agents: All agents; coordinates of those that are not placed yet are NaN.
        """
        self.seed = seed
        self._scenery = Scenery(obstacles)
        self._regions = regions
        self._bounds = bounds
        self._free = tuple(free)
        self._agents = agents
        #: The places that are taken, and the radii of the bodies there, by use.
        self._taken: dict[Path, tuple[Array, Array]] = {}

    def taken(self, use: Path) -> tuple[Array, Array]:
        """Return the places that are taken for a use, shape (m, 2), and the radii of the bodies there, shape (m,)."""
        if use not in self._taken:
            places, radii = [np.empty((0, 2))], [np.empty(0)]
            for group in self._agents:
                found = group.positions[:, :2]
                if use != ("state",):
                    known = [place for each in group.known(str(use[-1])) for place in positions_in(each)]
                    found = np.array(known, float).reshape(-1, 2)
                found = found[np.isfinite(found).all(axis=1)]
                places.append(found)
                radii.append(np.full(len(found), group.radius))
            self._taken[use] = np.concatenate(places), np.concatenate(radii)
        return self._taken[use]

    def take(self, use: Path, place: Array, radius: float) -> None:
        """Take a place, of shape (2,)."""
        places, radii = self.taken(use)
        self._taken[use] = np.concatenate([places, place[None]]), np.append(radii, radius)

    def area(self, placement: FreePlacement) -> tuple[Bounds, Sequence[PlacedRegion], Sequence[PlacedRegion]]:
        """Return the bounds of a placement, the regions that contain its places, and the regions that exclude them.

        Raises:
            PlacementError: The placement has no bounds, or its regions are unknown or move.
        """
        names = [*self._free, *([placement.within] if isinstance(placement.within, str) else [])]
        bounds = placement.within if isinstance(placement.within, tuple) else self._bounds
        for name in (*names, *placement.outside):
            region = self._regions.get(name)
            if region is None:
                raise PlacementError(f"there is no region {quoted(name)}")
            if region.around is not None or any(self._regions[each].around is not None for each in region.names()):
                raise PlacementError(f"the region {quoted(name)} moves with an agent")
        if isinstance(placement.within, str):
            bounds = _both(bounds, self._bounds_of(self._regions[placement.within]))
        if bounds is None:
            raise PlacementError("it needs an area: `within: [x, x, y, y]`")
        if bounds[0] >= bounds[1] or bounds[2] >= bounds[3]:
            raise PlacementError(f"the region {quoted(str(placement.within))} is not in the map")
        from symaware_cli.specification import PlacedRegion

        inside = [PlacedRegion(name, self._regions, _unanchored) for name in names]
        return bounds, inside, [PlacedRegion(name, self._regions, _unanchored) for name in placement.outside]

    def is_clear(self, points: Array, distance: float) -> NDArray[np.bool_]:
        """Return which points, (m, 2), are at least a distance [m] away from all obstacles; shape (m,)."""
        clear = np.ones(len(points), bool)
        if len(self._scenery):
            near = self._scenery.nearest(points, distance)
            clear[near.row[near.distance < distance]] = False
        return clear

    def _bounds_of(self, region: RegionShape) -> Bounds | None:
        """Return the bounds of a region; None if it has none."""
        if region.box is not None:
            return (*region.box[:2], *(region.box[2:4] or (-LARGEST, LARGEST)))  # type: ignore[return-value]
        if region.circle is not None:
            (x, y), radius = region.circle.centre[:2], region.circle.radius
            return x - radius, x + radius, y - radius, y + radius
        if region.polygon is not None:
            corners = np.array(region.polygon)
            (low_x, low_y), (high_x, high_y) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
            return low_x, high_x, low_y, high_y
        if region.complement is not None:
            return None
        members = [self._regions[each] if isinstance(each, str) else each for each in region.members]
        found = [self._bounds_of(each) for each in members]
        if region.union is not None:
            known = [each for each in found if each is not None]
            if len(known) < len(found):
                return None
            return around(known)
        bounds: Bounds | None = None
        for each in found:
            bounds = _both(bounds, each)
        return bounds


class GroupPlaces(Places):
    """Places the agents of a group in the free space."""

    def __init__(self, space: FreeRoom, ids: Sequence[str], radius: float) -> None:
        """Prepare places for agents with some ids, whose bodies have a bounding circle of a radius [m]."""
        self._space = space
        self._ids = ids
        self._radius = radius
        self._numbers = agent_numbers(ids)
        #: By purpose, for each attempt: the draws of all agents, and whether each is clear of obstacles.
        self._drawn: dict[str, list[tuple[Array, NDArray[np.bool_]]]] = {}

    def poses(self, placement: FreePlacement, path: Path, purpose: str, rows: Sequence[int]) -> tuple[Array, Array]:
        """Draw places for one agent after the other, until each has room."""
        use, radius = path[2:], self._radius
        drawn = self._drawn.setdefault(purpose, [])
        columns = 2 if placement.height is None else 3
        positions = np.full((len(rows), columns), 0.0 if placement.height is None else placement.height)
        headings = np.full(len(rows), 0.0 if placement.heading == "any" else placement.heading)
        for index, row in enumerate(rows):
            places, radii = self._space.taken(use)
            least = (radii + radius + placement.apart) ** 2
            for attempt in range(_TRIES):
                if attempt == len(drawn):
                    drawn.append(self._draw(placement, f"{purpose}.{attempt}"))
                values, clear = drawn[attempt]
                if clear[row] and bool((((places - values[row, :2]) ** 2).sum(axis=1) >= least).all()):
                    break
            else:
                raise PlacementError(
                    f"{quoted(self._ids[row])} has no room, as no place was found for it in {_TRIES} draws; take fewer "
                    "agents, smaller distances `apart` and `clear`, or a larger area"
                )
            positions[index, :2] = values[row, :2]
            if placement.heading == "any":
                headings[index] = values[row, 2]
            self._space.take(use, values[row, :2], radius)
        return positions, headings

    def _draw(self, placement: FreePlacement, purpose: str) -> tuple[Array, NDArray[np.bool_]]:
        """Draw a pose for each agent, (n, 3), and return whether each is clear of obstacles and regions, (n,)."""
        (left, right, bottom, top), inside, outside = self._space.area(placement)
        values = GroupChance(self._space.seed, purpose, self._numbers).uniform(3)
        low, high = np.array([left, bottom, -np.pi]), np.array([right, top, np.pi])
        values = low + values * (high - low)
        distance = self._radius + placement.clear
        points = np.concatenate([values[:, :2], np.full((len(values), 1), placement.height or 0.0)], axis=1)
        clear = self._space.is_clear(points, distance)
        for region in inside:
            clear &= region.robustness(points) >= 0.0
        for region in outside:
            clear &= region.robustness(points) <= -distance
        return values, clear


def positions_in(known: Any) -> Iterator[Sequence[float]]:
    """Yield the positions [x, y] in a value of knowledge, which is a position or a list of positions."""
    if known is None:
        return
    try:
        values = np.array(known, float)
    except (TypeError, ValueError):
        return
    if values.ndim in (1, 2) and values.shape[-1] in (2, 3):
        yield from values.reshape(-1, values.shape[-1])[:, :2].tolist()


def around(areas: Sequence[Bounds]) -> Bounds | None:
    """Return the bounds of the union of areas; None if there are none."""
    if not areas:
        return None
    left, right, bottom, top = zip(*areas, strict=True)
    return min(left), max(right), min(bottom), max(top)


def _both(one: Bounds | None, other: Bounds | None) -> Bounds | None:
    """Return the intersection of two bounds; None stands for no bounds."""
    if one is None or other is None:
        return other if one is None else one
    return max(one[0], other[0]), min(one[1], other[1]), max(one[2], other[2]), min(one[3], other[3])


def _unanchored(agent: str) -> Any:
    raise ValueError(f"the region moves with {agent}")
