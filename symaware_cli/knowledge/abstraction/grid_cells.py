"""A knowledge model of square cells."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydantic import Field

from symaware_cli.geometry import Region
from symaware_cli.knowledge.abstraction.box_in_region import lies_within, overlaps
from symaware_cli.knowledge.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.knowledge.abstraction.transition_system import TransitionSystem
from symaware_cli.world import ParameterError, Parameters

#: The greatest number of cells.
_MOST_CELLS = 10_000


class GridCells(KnowledgeModel):
    """Square cells that cover a box, without those that overlap an obstacle.

    An agent may stay in its cell or move to one of the up to four that share a side with it. Cells are called
    ``c<column>_<row>``, from the least coordinates on.
    """

    class Parameters(Parameters):
        """The size of the cells, and the region that they cover."""

        cell: float = Field(gt=0, description="Side of a cell [m].")
        region: str = Field(description="The region to cover: the name of a box.")
        obstacles: tuple[str, ...] = Field((), description="Names of regions that no cell may overlap.")
        margin: float = Field(0.0, ge=0, description="Distance that cells keep from obstacles [m].")

    def prepare(self, regions: Mapping[str, Region]) -> None:
        """Make the cells."""
        given = self.parameters
        named: list[tuple[tuple[str | int, ...], str]] = [(("region",), given.region)]
        named += [(("obstacles", number), name) for number, name in enumerate(given.obstacles)]
        for place, name in named:
            if name not in regions:
                raise ParameterError(f"there is no region `{name}`", place)
            if regions[name].around is not None:
                raise ParameterError(f"the region `{name}` moves with an agent", place)
        box = regions[given.region].box
        if box is None or len(box) < 4:
            raise ParameterError(f"the region `{given.region}` is not a box of two coordinates", ("region",))
        counts = [round((box[2 * axis + 1] - box[2 * axis]) / given.cell) for axis in (0, 1)]
        for axis, count in enumerate(counts):
            if count < 1 or abs(count * given.cell - (box[2 * axis + 1] - box[2 * axis])) > 1e-9 * count:
                raise ParameterError(
                    f"cells of {given.cell:g} m do not fill the region `{given.region}`: it extends over "
                    f"{box[2 * axis + 1] - box[2 * axis]:g} m along {'xy'[axis]}",
                    ("cell",),
                )
        if counts[0] * counts[1] > _MOST_CELLS:
            said = f"there would be {counts[0] * counts[1]:,} cells: at most {_MOST_CELLS:,} are possible"
            raise ParameterError(said, ("cell",))
        places, bounds = [], []
        for row in range(counts[1]):
            for column in range(counts[0]):
                low = np.array([box[0] + column * given.cell, box[2] + row * given.cell])
                cell = np.stack([low, low + given.cell], axis=1)
                grown = cell + np.array([-given.margin, given.margin])
                if not any(overlaps(grown, regions[name], regions) for name in given.obstacles):
                    places.append((column, row))
                    bounds.append(cell)
        if not places:
            raise ParameterError("obstacles cover every cell", ("obstacles",))
        index = {place: number for number, place in enumerate(places)}
        self.bounds = np.array(bounds)
        self.system = TransitionSystem(
            tuple(f"c{column}_{row}" for column, row in places),
            tuple(range(len(places))),
            tuple(tuple(index[after] for after in _neighbourhood(*place) if after in index) for place in places),
            labels_of(self.bounds, regions),
        )


def labels_of(bounds: np.ndarray, regions: Mapping[str, Region]) -> dict[str, frozenset[int]]:
    """Return the boxes that lie within each region, by its name, of regions that do not move.

    Args:
        bounds: The boxes; shape (n, 2, 2).
        regions: The regions by name.
    """
    return {
        name: frozenset(cell for cell, box in enumerate(bounds) if lies_within(box, region, regions))
        for name, region in regions.items()
        if region.around is None
    }


def _neighbourhood(column: int, row: int) -> tuple[tuple[int, int], ...]:
    """Return a place itself, then those that share a side with it."""
    return ((column, row), (column + 1, row), (column, row + 1), (column - 1, row), (column, row - 1))
