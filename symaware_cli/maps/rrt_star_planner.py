"""Planning of paths by RRT*.

Reasons: docs/decisions/0095-planners-off-the-grid.md
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from symaware_cli.geometry import LARGEST, Array
from symaware_cli.maps.free_planner import SamplingPlanner
from symaware_cli.maps.path_planner import PathRequest
from symaware_cli.maps.planned_path import PlannedPath
from symaware_cli.maps.rrt_star import RapidTree

#: The greatest length of a new branch by default, in the greater extents of the area.
_STEP = 0.2


class RapidTreePlanner(SamplingPlanner):
    """Plans a path to the ``goal`` by RRT*, and writes it as ``waypoints`` and ``path_cost``.

    Each plan grows a tree from where the agent is, by positions that are drawn from the area, and later from where a
    shorter path may be; the draws are keyed by the seed of the run, the agent and the instant. On its branches a disc
    around the agent, widened by a margin, touches no fixed obstacle. The cost is the length. It never rises with the
    number of iterations, which is the same for each plan, whether or when a path was found; so runs repeat. If the
    straight line is free, no tree is needed. See `symaware_cli.maps.rrt_star`.

    When an agent plans, what it writes and which events it fires is as for `planning.grid`.
    """

    unit: ClassVar[str] = "iterations"

    events: ClassVar = {
        "path-planned": "An agent has a path; `cost` and `length` [m] are its length, `expanded` the iterations.",
        "goal-unreachable": "No path to the goal of an agent was found within the iterations.",
    }

    class Parameters(SamplingPlanner.Parameters):
        """The tree and the body."""

        iterations: int = Field(2000, ge=1, le=100_000, description="How many positions are drawn for each plan.")
        step: float | None = Field(
            None,
            gt=0,
            le=LARGEST,
            description="The greatest length of a new branch [m]. By default a fifth of the area's greater extent.",
        )

    def _between(self, row: int, start: Array, goal: Array, request: PathRequest) -> PlannedPath:
        count, within = self.parameters.iterations, self._area_within
        step = self.parameters.step or _STEP * max(within[1] - within[0], within[3] - within[2])
        # The draws are of a kind of their own for each agent, so that they do not depend on who else plans now.
        rows, numbers = np.full(count, row), np.arange(count, dtype=np.uint64)
        draws = self.random.uniform_of(rows, numbers, 2, f"tree of {self._group.ids[row]}")
        return RapidTree(self._space, within, (start, goal), step, self._regions(request.closed)).path(draws)
