"""Planning of paths that cars can follow.

Reasons: docs/decisions/0095-planners-off-the-grid.md
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup
from symaware_cli.geometry import LARGEST, Array
from symaware_cli.maps.free_planner import FreePlanner
from symaware_cli.maps.lattice import Lattice, LatticeSearch
from symaware_cli.maps.path_planner import PathRequest
from symaware_cli.maps.planned_path import PlannedPath, no_path
from symaware_cli.world import ParameterError

#: The least radius of arcs by default, in radii of the tightest turn of the model: a controller needs some reserve.
_WIDER = 1.2

#: The least side of the cells, in least radii of arcs: primitives are searched among the cells within a few radii.
_LEAST_SIDE = 0.02

#: The side of the cells by default, in least radii of arcs.
_SIDE = 1.0 / 3.0


class LatticePlanner(FreePlanner):
    """Plans a path of arcs and straight lines to the ``goal``, which a car can follow from the heading that it has.

    The path is a shortest one on a lattice of positions and 16 headings, which begins at the pose of the agent. From
    each state seven motions lead to others: straight on, or by arcs to either side. No arc is tighter than
    `turning_radius`; the car only drives forwards. On the way a disc around the agent, widened by a margin, touches no
    fixed obstacle. The goal is a position that may be reached with any heading. The cost is the length. The
    ``waypoints`` are points on the path, which `control.pure-pursuit` follows. See `symaware_cli.maps.lattice`.

    The times of planning, the written values and the events are those of `planning.grid`.
    """

    unit: ClassVar[str] = "states"

    events: ClassVar = {
        "path-planned": "An agent has a path; `cost` [m] is its length, `length` [m] that of the lines through its "
        "waypoints, `expanded` the states.",
        "goal-unreachable": "The lattice has no path to the goal of an agent, or none was found within the limit.",
    }

    class Parameters(FreePlanner.Parameters):
        """The lattice, the body and the limit."""

        turning_radius: float | None = Field(
            None, gt=0, le=LARGEST, description="The least radius of arcs [m]. By default 1.2 times that of the model."
        )
        resolution: float | None = Field(
            None, gt=0, le=LARGEST, description="The side of the cells [m]. By default a third of that radius."
        )
        most_nodes: int = Field(
            50_000, ge=1, le=10_000_000, description="The greatest number of states that a search expands."
        )

    uncaptured = ("_space", "_area_within", "_lattice")

    def check(self, group: AgentGroup) -> None:
        """Check that the model has a heading and can turn as tightly, after the checks of `FreePlanner`."""
        self._side(group)
        super().check(group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Compute the lattice."""
        super().initialise_component(group)
        self._lattice = Lattice(self._space, self._area_within, self._turning_radius(group), self._side(group))

    def _find(self, row: int, start: Array, request: PathRequest) -> PlannedPath:
        goal, model = np.array(request.goal), self._group.model
        if not self._is_within(start) or not self._is_within(goal):
            return no_path(0)
        heading = float(self._group.awareness.state[row, model.heading])
        search = LatticeSearch(self._lattice, start, heading, goal, self._regions(request.closed))
        return search.path(self.parameters.most_nodes)

    def _turning_radius(self, group: AgentGroup) -> float:
        """Return the least radius of arcs [m]."""
        given: float | None = self.parameters.turning_radius
        model = group.model
        if getattr(model, "heading", None) is None:
            raise ValueError("it plans for agents with a heading, such as those of the model `bicycle`")
        if not hasattr(model, "wheelbase"):
            if given is None:
                raise ParameterError("the turning radius is needed, as the model is no car", ("turning_radius",))
            return given
        tightest = float(model.wheelbase / np.tan(model.input_bounds()[1][1]))
        if given is not None and given < tightest * (1.0 - 1e-9):
            said = f"the model cannot turn as tightly: its turning radius is {tightest:.4g} m"
            raise ParameterError(said, ("turning_radius",))
        return given or _WIDER * tightest

    def _side(self, group: AgentGroup) -> float:
        """Return the side of the cells [m]."""
        radius = self._turning_radius(group)
        side: float = self.parameters.resolution or _SIDE * radius
        if side < _LEAST_SIDE * radius:
            said = f"the cells are too small for turns of {radius:.4g} m: at least {_LEAST_SIDE * radius:.4g} m"
            raise ParameterError(said, ("resolution",))
        return side
