"""Risk maps: the risk of being at each place of a grid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, field_validator

from symaware_cli.awareness import BOX_COLUMNS
from symaware_cli.core import AgentGroup, Parameters, Quantity, Signal, Tracks
from symaware_cli.engine.components.risk.body_pairs import BodyPairs
from symaware_cli.engine.components.risk.collision import Collision
from symaware_cli.engine.components.risk.outlines import Side
from symaware_cli.geometry import Array, Indices, Mask, Number, Pieces, separation_from_points
from symaware_cli.world import nanoseconds

#: The greatest number of cells of all agents of a group together.
MOST_CELLS = 100_000

RISK_MAP = Signal(
    "map",
    kind="table",
    columns=(*(Quantity(each, "m") for each in BOX_COLUMNS), Quantity("level", "1")),
    drawn="areas",
    description="the risk of being in each cell of the grid; cells with less than the least risk are left out",
)

EVALUATIONS = Signal(
    "evaluations",
    columns=[Quantity("evaluations", "1")],
    description="of how many cells and others the probability of a collision was computed for the map",
)


class CellPairs(BodyPairs):
    """Pairs of places where an agent might stand, and of others."""

    def __init__(self, cells: Indices, apart: Array, closing: Array, radius: Array, covariance: Array | None) -> None:
        self.observers = cells
        self.apart, self.closing, self.radius = apart, closing, radius
        self.round: Mask = np.ones(len(radius), bool)
        self.covariance = covariance

    def sides(self, rows: Indices) -> tuple[Side, Side]:
        """See `BodyPairs`: a disc of the whole radius, and a point."""
        still = np.zeros(len(rows))
        nowhere, known = np.zeros((len(rows), 2)), np.zeros(len(rows), bool)
        disc, point = Pieces.points(nowhere, self.radius.take(rows)), Pieces.points(nowhere)
        return Side(disc, still, still, still, known), Side(point, still, still, still, known)


class MapTurn(NamedTuple):
    """The result of a turn.

    Attributes:
        tables: The rows of the map of each agent.
        evaluations: How many encounters each evaluated; shape (n, 1).
    """

    tables: list[Array]
    evaluations: Array


class RiskMap(Collision):
    """The risk of being at each place: for the cells of a grid, a bound of the probability of a collision there.

    It is that of `risk.collision` for an agent that stands at the centre of the cell until the horizon, with a disc
    that contains its body. Obstacles do not count. The map is recorded as the signal `map`, and drawn in replays.

    Where an agent knows that another stays in a set, as from a promise, the encounter is evaluated only in cells from
    which the agent could touch the set, enlarged by the other's body. In all others its risk is the declared
    probability of leaving the set, or 0 with ``promises: if-kept``. The signal `evaluations` counts the evaluations.
    """

    batchable = False
    signals: ClassVar = (RISK_MAP, EVALUATIONS)

    class Parameters(Parameters):
        """The grid, and what counts as a collision."""

        within: tuple[Number, Number, Number, Number] = Field(description="The area of the grid: [x, x, y, y] [m].")
        resolution: float = Field(0.5, gt=0, le=1e6, description="Side of the cells [m].")
        horizon: float = Field(3.0, gt=0, description="How far ahead to look [s].")
        reach: float = Field(10.0, gt=0, description="Others farther away from the agent are not looked at [m].")
        margin: float = Field(0.0, ge=0, description="Distance between two bodies that counts as a collision [m].")
        least: float = Field(0.01, gt=0, lt=1, description="The least risk of a cell that is recorded.")
        record: float = Field(1.0, gt=0, le=1e6, description="Time between two maps [s].")
        promises: Literal["paid", "if-kept", "ignored"] = Field(
            "paid",
            description="What promises of others to stay in a region count: the risk contains the declared probability "
            "that they are broken (`paid`), or is the risk if all are kept (`if-kept`), or they do not count.",
        )

        @field_validator("within")
        @classmethod
        def _is_area(cls, within: tuple[float, ...]) -> tuple[float, ...]:
            if within[0] >= within[1] or within[2] >= within[3]:
                raise ValueError("the least of a coordinate is not below its greatest")
            return within

    def check(self, group: AgentGroup) -> None:
        """Check that the model moves in the plane, and that there are not too many cells."""
        if len(group.model.position) != 2:
            raise ValueError("maps are in the plane, and the model moves in space")
        columns, rows = self._shape()
        if columns * rows * len(group) > MOST_CELLS:
            said = f"the maps of {len(group)} agents would have {columns} x {rows} cells each"
            raise ValueError(f"{said}, and may have {MOST_CELLS:,} together")

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """Declare nothing: the risk of where the agent is, is that of other components."""
        return {}

    def initialise_component(self, group: AgentGroup) -> None:
        """Compute the cells."""
        super().initialise_component(group)
        given = self.parameters
        columns, rows = self._shape()
        west, south, side = given.within[0], given.within[2], given.resolution
        x, y = west + side * np.arange(columns), south + side * np.arange(rows)
        low = np.stack([np.tile(x, rows), np.repeat(y, columns)], axis=1)
        #: The bounds of the cells: x, x, y, y [m]; shape (cells, 4).
        self._bounds = np.stack([low[:, 0], low[:, 0] + side, low[:, 1], low[:, 1] + side], axis=1)
        self._centres = low + 0.5 * side
        self._due = 0

    def _shape(self) -> tuple[int, int]:
        """Return the number of columns and rows of the grid, which covers its area."""
        west, east, south, north = self.parameters.within
        side = self.parameters.resolution
        # None for a rounding error.
        return max(1, int(np.ceil((east - west) / side - 1e-6))), max(1, int(np.ceil((north - south) / side - 1e-6)))

    def _compute(self) -> MapTurn | None:  # type: ignore[override]
        if self.now < self._due:
            return None
        group, given = self._group, self.parameters
        tracks = group.others(given.reach)
        around = [] if given.promises == "ignored" else group.confined(tracks)
        tables, counts = [], []
        for row in range(len(group)):  # the grids of agents together may be large
            risk, evaluated = np.zeros(len(self._centres)), 0
            for place in range(*tracks.pointers[row : row + 2].tolist()):
                radius = group.entity.radius + float(self._known.radii[tracks.others[place]]) + given.margin
                cells, beyond = np.ones(len(risk), bool), np.ones(len(risk))
                for confined in around:
                    for number in np.flatnonzero(confined.rows == place).tolist():
                        piece = confined.sets.take(np.full(len(risk), number))
                        found = separation_from_points(self._centres, np.zeros(len(risk)), piece)
                        away = found.distance > radius
                        cells &= ~away
                        beyond[away] = np.minimum(beyond[away], confined.breach[number])
                some = np.flatnonzero(cells)
                evaluated += len(some)
                added = np.zeros(len(risk)) if given.promises == "if-kept" else np.where(cells, 0.0, beyond)
                added[some] = self._probability(self._pairs_of(tracks, place, some, radius - given.margin))
                risk += added
            risk = np.minimum(risk, 1.0)
            kept = risk >= given.least
            tables.append(np.column_stack([self._bounds[kept], risk[kept]]))
            counts.append([float(evaluated)])
        return MapTurn(tables, np.array(counts).reshape(-1, 1))

    def _pairs_of(self, tracks: Tracks, place: int, cells: Indices, radius: float) -> CellPairs:
        """Return the pairs of some cells and one other; seen from above."""
        count, size = len(cells), tracks.positions.shape[1]
        covariance = None
        if tracks.covariances is not None:
            plane = [0, 1, size, size + 1]
            covariance = np.repeat(tracks.covariances[place : place + 1][:, plane][:, :, plane], count, axis=0)
        return CellPairs(
            cells,
            np.ascontiguousarray((tracks.positions[place, :2] - self._centres[cells]).T),
            np.repeat(tracks.velocities[place, :2, None], count, axis=1),
            np.full(count, radius),
            covariance,
        )

    def _update(self, value: MapTurn | None) -> None:  # type: ignore[override]
        if value is None:
            return
        self.record(RISK_MAP, value.tables)
        self.record(EVALUATIONS, value.evaluations)
        every = nanoseconds(self.parameters.record)
        self._due = (self.computed_at // every + 1) * every
