"""Beliefs of agents about the map around them, from the scans of their lidars.

Reasons: docs/decisions/0087-sensing.md
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from symaware_cli.awareness import BOX_COLUMNS
from symaware_cli.core import AgentGroup, GroupComponent, Quantity, ScenarioView, Signal
from symaware_cli.engine import ScanOptions, ScanReturns, ScanSurfaces, bounding_radii, check_scan
from symaware_cli.geometry import LARGEST, Array, Number
from symaware_cli.maps.floor import Floor
from symaware_cli.maps.occupancy_grid import OccupancyModel, Odds
from symaware_cli.maps.planning_grid import GridFrame
from symaware_cli.maps.raster import FREE, OCCUPIED
from symaware_cli.maps.rectangles import merged
from symaware_cli.world import ParameterError, nanoseconds
from symaware_cli.world import Parameters as PluginParameters

#: The greatest number of cells of all agents of a group together: each takes four bytes, also in captured states.
MOST_BELIEFS = 10_000_000

MAP = Signal(
    "map",
    kind="table",
    columns=(*(Quantity(each, "m") for each in BOX_COLUMNS), Quantity("occupied", "1")),
    drawn="areas",
    description="what the agent believes of the map: areas that are occupied (1) or free (0), others are unknown",
)


class MapUpdate(NamedTuple):
    """The result of a turn.

    Attributes:
        returns: The scan that was read.
        odds: The log odds of the cells of all agents, shape (n, cells); None if no scan is new.
        tables: The areas of each agent, if they are due to be recorded.
    """

    returns: ScanReturns
    odds: Odds | None
    tables: list[Array] | None


class MapPerception(GroupComponent):
    """Keeps for each agent an occupancy grid of log odds from the scans of its lidar.

    Each scan raises the probability that the cells in which rays end are occupied, and lowers that of the cells which
    rays cross. Cells that no ray has met stay unknown. Rays that end at agents of which an agent is aware are ignored;
    other agents leave a trace until a ray crosses it.

    Rays are taken to begin at the position at which the agent believed to be when they were measured. The belief is
    recorded as the signal `map`: rectangles of occupied and of free cells.
    """

    signals = (MAP,)

    class Parameters(PluginParameters):
        """The grid, and the probabilities of the sensor model."""

        scan: str = Field(description="The name of the lidar.")
        resolution: float | None = Field(
            None, gt=0, le=LARGEST, description="Side of the cells [m]. By default that of the map."
        )
        within: tuple[Number, Number, Number, Number] | None = Field(
            None, description="The area of the map: [x, x, y, y] [m]. By default the extent of the scenario's map."
        )
        record: float = Field(1.0, gt=0, le=1e6, description="Time between two records of the belief [s].")
        hit: float = Field(0.7, gt=0.5, lt=1, description="Probability that a cell is occupied in which a ray ends.")
        miss: float = Field(0.4, gt=0, lt=0.5, description="Probability that one is through which a ray passes.")
        certain: float = Field(0.97, gt=0.5, lt=1, description="The greatest probability of a cell.")
        occupied: float = Field(0.65, ge=0.5, lt=1, description="Cells with a greater probability are occupied.")
        free: float = Field(0.35, gt=0, le=0.5, description="Cells with a smaller probability are free.")

        @field_validator("within")
        @classmethod
        def _is_area(cls, within: tuple[float, ...] | None) -> tuple[float, ...] | None:
            if within is not None and (within[0] >= within[1] or within[2] >= within[3]):
                raise ValueError("the least of a coordinate is not below its greatest")
            return within

        @model_validator(mode="after")
        def _can_be_certain(self) -> Self:
            if self.certain <= max(self.occupied, 1.0 - self.free):
                raise ValueError("`certain` has to be greater than `occupied`, and than 1 - `free`")
            return self

    def check(self, group: AgentGroup) -> None:
        """Check that there is a grid."""
        self._frame_of(group)
        if len(group.model.position) != 2:
            raise ValueError("maps are in the plane, and the model moves in space")

    def check_scenario(self, view: ScenarioView) -> None:
        """Check that the scan exists."""
        check_scan(view, self.parameters.scan)

    def initialise_component(self, group: AgentGroup) -> None:
        """Begin with unknown cells only."""
        super().initialise_component(group)
        given = self.parameters
        self._frame = self._frame_of(group)
        self._model = OccupancyModel(given.hit, given.miss, given.certain, given.occupied, given.free)
        self._surfaces = ScanSurfaces(given.scan, ScanOptions(), group.entity.radius)
        self._radii = bounding_radii(self.environment)
        rows, columns = self._frame.shape
        #: The log odds of each cell, 0 where nothing is known; shape (n, cells).
        self._odds: Odds = np.zeros((len(group), rows * columns), np.float32)
        self._read = -1
        self._due = 0

    def _compute(self) -> MapUpdate:
        returns, odds = self._surfaces.returns(self._group, self.now), None
        if returns.time > self._read:
            dark = returns.unseen | self._surfaces.of_others(self._group, returns.points, self._radii)
            is_hit = np.isfinite(returns.points[..., 0])
            outwards = np.stack([np.cos(returns.angles), np.sin(returns.angles)], axis=2)
            ends = np.where(is_hit[..., None], returns.points, returns.origins[:, None] + returns.range * outwards)
            # A loop over agents: each scan concerns few cells of a large map.
            odds = np.stack(
                [
                    self._model.updated(
                        self._odds[row],
                        self._frame,
                        returns.origins[row],
                        ends[row, ~dark[row]],
                        is_hit[row, ~dark[row]],
                    )
                    for row in range(len(ends))
                ]
            )
        tables = None
        if self.now >= self._due:
            tables = [
                self._areas(self._believed(row, each)) for row, each in enumerate(self._odds if odds is None else odds)
            ]
        return MapUpdate(returns, odds, tables)

    def _update(self, value: MapUpdate) -> None:
        self._surfaces.remember(self._group, self.computed_at, value.returns)
        if value.odds is not None:
            self._odds, self._read = value.odds, value.returns.time
        if value.tables is not None:
            self.record(MAP, value.tables)
            every = nanoseconds(self.parameters.record)
            self._due = (self.computed_at // every + 1) * every

    def _believed(self, row: int, odds: Odds) -> Odds:
        """Return the log odds that an agent believes in, given those of its own scans; both of shape (cells,)."""
        return odds

    def _areas(self, odds: Odds) -> Array:
        """Return the known areas, as rows of the signal."""
        cells, side = self._model.cells(odds, self._frame), self._frame.resolution
        west, south = self._frame.origin
        parts = []
        for state, is_occupied in ((OCCUPIED, 1.0), (FREE, 0.0)):
            found = merged(cells == state).astype(float)
            x, y = west + side * found[:, [0, 2]], south + side * found[:, [1, 3]]
            parts.append(np.column_stack([x, y, np.full(len(found), is_occupied)]))
        return np.concatenate(parts)

    def _frame_of(self, group: AgentGroup) -> GridFrame:
        """Return the frame of the grid."""
        given, floor = self.parameters, group.sections.get("map")
        raster = floor.raster if isinstance(floor, Floor) else None
        side = given.resolution or (raster.resolution if raster is not None else None)
        if side is None:
            raise ParameterError(
                "the side of the cells is needed, as the scenario has no map of cells", ("resolution",)
            )
        within = given.within or (floor.bounds if isinstance(floor, Floor) else None)
        if within is None:
            raise ParameterError("the area of the map is needed, as the scenario has no map with bounds", ("within",))
        width, height = within[1] - within[0], within[3] - within[2]
        # Enough cells to cover the area, but no additional one because of a rounding error.
        shape = (max(1, int(np.ceil(height / side - 1e-6))), max(1, int(np.ceil(width / side - 1e-6))))
        if shape[0] * shape[1] * len(group) > MOST_BELIEFS:
            said = f"the maps of {len(group)} agents would have {shape[0]} x {shape[1]} cells each"
            raise ParameterError(f"{said}, and may have {MOST_BELIEFS:,} together", ("resolution",))
        return GridFrame((within[0], within[2]), 0.0, side, shape)
