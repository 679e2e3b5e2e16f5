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

#: The greatest length of a new branch by default, relative to the greater extent of the area.
_STEP = 0.2


class RapidTreePlanner(SamplingPlanner):
    """Plans a path to the ``goal`` by RRT*, and writes it as ``waypoints`` and ``path_cost``.

    Each plan grows a tree from the position of the agent, by positions that are drawn from the area, and later from the
    part of it that a shorter path may pass; the draws are keyed by the seed of the run, the agent and the instant. On
    the branches a disc around the agent, widened by a margin, touches no fixed obstacle. The cost is the length, which
    never rises with the number of iterations. That number is the same for each plan, no matter whether or when a path
    was found, so runs are repeatable. If the straight line is free, no tree is needed. See
    `symaware_cli.maps.rrt_star`.

    The times of planning, the written values and the events are those of `planning.grid`.
    """

    unit: ClassVar[str] = "iterations"

    events: ClassVar = {
        "path-planned": "An agent has a path; `cost` and `length` [m] are its length, `expanded` the iterations.",
        "goal-unreachable": "No path to the goal of an agent was found within the iterations.",
    }

    class Parameters(SamplingPlanner.Parameters):
        """The tree and the body."""

        iterations: int = Field(2000, ge=1, le=100_000, description="Number of random positions for each plan.")
        step: float | None = Field(
            None,
            gt=0,
            le=LARGEST,
            description="The greatest length of a new branch [m]. By default a fifth of the area's greater extent.",
        )

    def _between(self, row: int, start: Array, goal: Array, request: PathRequest) -> PlannedPath:
        count, within = self.parameters.iterations, self._area_within
        step = self.parameters.step or _STEP * max(within[1] - within[0], within[3] - within[2])
        # Each agent has draws of a separate kind, so that they do not depend on which other agents plan at the same
        # time.
        rows, numbers = np.full(count, row), np.arange(count, dtype=np.uint64)
        draws = self.random.uniform_of(rows, numbers, 2, f"tree of {self._group.ids[row]}")
        return RapidTree(self._space, within, (start, goal), step, self._regions(request.closed)).path(draws)
