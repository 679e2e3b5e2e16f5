"""Named regions in expressions: their position at an instant, and the depth of points within them."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from symaware_cli.geometry import Array, relative
from symaware_cli.specification.formula import encoded

if TYPE_CHECKING:
    from symaware_cli.geometry import Region, RegionShape

#: Returns the pose of an agent: position, shape (k,) [m], NaN while it is absent; heading [rad], None if it has none.
#: In predictions there is one for each row: shapes (n, k) and (n,).
Anchor = Callable[[str], tuple[Array, float | Array | None]]


class RegionError(ValueError):
    """A region refers to a name that it cannot use.

    Attributes:
        region: The region's name.
        name: The invalid name in it.
    """

    def __init__(self, message: str, region: str, name: str) -> None:
        super().__init__(message)
        self.region = region
        self.name = name


def check_names(regions: Mapping[str, Region]) -> None:
    """Check that regions refer only to other, static regions, without cycles.

    Raises:
        RegionError: A reference is invalid.
    """
    for start in regions:
        seen, waiting = {start}, list(regions[start].names())
        while waiting:
            name = waiting.pop()
            if name not in regions:
                raise RegionError(f"there is no region `{name}`", start, name)
            if name == start:
                raise RegionError(f"the region `{start}` is made of itself", start, name)
            if regions[name].around is not None:
                said = f"the region `{name}` moves with an agent, so no other can be made of it"
                raise RegionError(said, start, name)
            if name not in seen:
                seen.add(name)
                waiting += regions[name].names()


class PlacedRegion:
    """A region at the present instant.

    Attributes:
        name: Its name.
        region: Its shape.
        dimensions: Minimum number of coordinates of a point.
    """

    def __init__(self, name: str, regions: Mapping[str, Region], anchor: Anchor) -> None:
        self.name = name
        self.region = regions[name]
        self._regions = regions
        self._anchor = anchor
        self.dimensions = self._dimensions(self.region)

    def at(self, anchor: Anchor) -> PlacedRegion:
        """Return the region with other poses of agents."""
        other = copy.copy(self)
        other._anchor = anchor
        return other

    def robustness(self, points: Array) -> Array:
        """Return the depth of points within the region [m], negative outside, encoded as by `formula.encoded`.

        For primitives this is the Euclidean distance to the boundary. For a union it is the greatest depth in a member
        and for an intersection the least; inside a union and outside an intersection, this may be less than the
        distance to the boundary, but never more.

        Args:
            points: Shape (n, d).

        Raises:
            ValueError: The points have fewer coordinates than the region.
        """
        if points.ndim != 2 or points.shape[1] < self.dimensions:
            found = 1 if points.ndim < 2 else points.shape[1]
            raise ValueError(f"the region `{self.name}` has {self.dimensions} coordinates, the point {found}")
        if self.region.around is not None:
            position, heading = self._anchor(self.region.around)
            points = relative(points, position, heading if self.region.turns else None)
            depths = self._robustness(self.region, points)
            return np.where(np.isnan(position).any(axis=-1), -np.inf, depths)
        return self._robustness(self.region, points)

    def _robustness(self, region: RegionShape, points: Array) -> Array:
        if not region.members:
            return encoded(region.depth(points[:, : region.dimensions]), holds_at_zero=True)
        if region.complement is not None:
            return -self._robustness(self._named(region.complement), points)
        polygons = _polygons(region)
        if polygons:
            # Maps and roads consist of hundreds: one call of NumPy for all of them.
            # Readers of tables need no shapes.
            from symaware_cli.geometry import polygon_depths

            depths = encoded(polygon_depths(polygons, points), holds_at_zero=True)
            extreme: Array = np.maximum.reduce(depths) if region.union is not None else np.minimum.reduce(depths)
            return extreme
        every = [self._robustness(self._named(each), points) for each in region.members]
        choose = np.maximum if region.union is not None else np.minimum
        total = every[0]
        for each in every[1:]:
            total = choose(total, each)
        return total

    def _named(self, member: str | RegionShape) -> RegionShape:
        return self._regions[member] if isinstance(member, str) else member

    def _dimensions(self, region: RegionShape) -> int:
        if not region.members:
            return region.dimensions
        return max(self._dimensions(self._named(each)) for each in region.members)


#: From how many polygons on a region is evaluated as a whole.
_MANY = 4


def _polygons(region: RegionShape) -> tuple[tuple[tuple[float, ...], ...], ...]:
    """Return the polygons that a region is composed of; empty if it has other members, or few."""
    if len(region.members) < _MANY:
        return ()
    found = []
    for member in region.members:
        if isinstance(member, str) or member.polygon is None:
            return ()
        found.append(member.polygon)
    return tuple(found)
