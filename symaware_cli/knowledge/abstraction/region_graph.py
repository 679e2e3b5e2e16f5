"""Knowledge models whose cells are regions of the scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.geometry import Region
from symaware_cli.knowledge.abstraction.grid_cells import labels_of
from symaware_cli.knowledge.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.knowledge.abstraction.transition_system import TransitionSystem
from symaware_cli.world import ParameterError, Parameters

Array = NDArray[np.float64]

#: Tolerance of comparisons of coordinates [m].
_TOLERANCE = 1e-9
#: The greatest number of cells, as they are compared in pairs.
_MOST_CELLS = 1_000


class RegionGraph(KnowledgeModel):
    """Cells that are regions: boxes, such as rooms and passages, which may differ in size.

    An agent may stay in its cell or move to one that shares a part of a side with it. The name of a cell is that of the
    region, which is also a label of it.
    """

    class Parameters(Parameters):
        """The cells."""

        regions: tuple[str, ...] = Field(min_length=1, description="The names of the boxes, no two of which overlap.")

    def prepare(self, regions: Mapping[str, Region]) -> None:
        """Find the cells that share sides."""
        names = self.parameters.regions
        if len(set(names)) < len(names):
            raise ParameterError("a region is a cell once", ("regions",))
        self.bounds = boxes(names, regions, "regions")
        after = [[place] for place in range(len(names))]
        for one, other in combinations(range(len(names)), 2):
            if shared_side(self.bounds[one], self.bounds[other]) > _TOLERANCE:
                after[one].append(other)
                after[other].append(one)
        self.system = TransitionSystem(
            tuple(names), tuple(range(len(names))), tuple(map(tuple, after)), labels_of(self.bounds, regions)
        )


def boxes(names: Sequence[str], regions: Mapping[str, Region], parameter: str) -> Array:
    """Return the bounds of regions that are to be cells [m]; shape (n, 2, 2), as [cell, axis, which].

    Raises:
        ParameterError: A region does not exist, is no box in the plane that keeps its place, or overlaps another one.
    """
    found = []
    for name in names:
        region = regions.get(name)
        if region is None:
            raise ParameterError(f"there is no region `{name}`", (parameter,))
        if region.around is not None or region.box is None or len(region.box) < 4:
            raise ParameterError(f"the region `{name}` is no box in the plane that keeps its place", (parameter,))
        found.append(np.reshape(region.box[:4], (2, 2)))
    if len(found) > _MOST_CELLS:
        raise ParameterError(f"there are {len(found):,} cells, more than {_MOST_CELLS:,}", (parameter,))
    for one, other in combinations(range(len(found)), 2):
        if (_common(found[one], found[other]) > _TOLERANCE).all():
            raise ParameterError(f"the regions `{names[one]}` and `{names[other]}` overlap", (parameter,))
    return np.array(found, float)


def shared_side(one: Array, other: Array) -> float:
    """Return the length of the side that two boxes share [m]; 0 if they do not touch, or at a corner only."""
    common = np.sort(_common(one, other))
    return float(common[1]) if abs(common[0]) <= _TOLERANCE else 0.0


def _common(one: Array, other: Array) -> Array:
    """Return how far two boxes overlap along each axis [m], negative where there is a gap; shape (2,)."""
    return np.asarray(np.minimum(one[:, 1], other[:, 1]) - np.maximum(one[:, 0], other[:, 0]))
