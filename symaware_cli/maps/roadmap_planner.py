"""Planning of paths on a probabilistic roadmap.

Reasons: docs/decisions/0095-planners-off-the-grid.md
"""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from symaware_cli.core import AgentGroup
from symaware_cli.geometry import Array
from symaware_cli.maps.free_planner import SamplingPlanner
from symaware_cli.maps.path_planner import PathRequest
from symaware_cli.maps.planned_path import PlannedPath
from symaware_cli.maps.roadmap import Roadmap
from symaware_cli.world import GroupChance, agent_numbers


class RoadmapPlanner(SamplingPlanner):
    """Plans a path to the ``goal`` on a graph of random positions, and writes it as ``waypoints`` and ``path_cost``.

    The graph is computed once, when the run begins, for the whole group: positions are drawn uniformly from the area,
    keyed by the seed of the run. Two near positions are joined if a disc around the agent, widened by a margin, touches
    no fixed obstacle between them (see `symaware_cli.maps.roadmap`). Each path then only takes a search on the graph,
    which suits many agents and goals in the same place. The cost is the length. More samples find shorter paths and
    narrower passages; the roadmap may lack a path that exists.

    The times of planning, the written values and the events are those of `planning.grid`.
    """

    unit: ClassVar[str] = "positions"

    events: ClassVar = {
        "path-planned": "An agent has a path; `cost` and `length` [m] are its length, `expanded` the positions.",
        "goal-unreachable": "The roadmap has no path to the goal of an agent, or none was found within the limit.",
    }

    class Parameters(SamplingPlanner.Parameters):
        """The roadmap, the body and the limit."""

        samples: int = Field(
            1000,
            ge=1,
            le=20_000,
            description="Number of random positions. Positions in which the body does not fit are dropped.",
        )
        most_nodes: int = Field(
            20_000, ge=1, le=1_000_000, description="The greatest number of positions that a search expands."
        )

    # The roadmaps, which follow from the scenario and its seed.
    uncaptured = ("_space", "_area_within", "_roadmap", "_roadmaps")

    def initialise_component(self, group: AgentGroup) -> None:
        """Compute the roadmap."""
        super().initialise_component(group)
        chance = GroupChance(self._surroundings.seed, f"component {self.name}.roadmap", agent_numbers([group.name]))
        drawn = chance.uniform(2 * self.parameters.samples).reshape(-1, 2)
        self._roadmap = Roadmap(self._space, self._placed(drawn), self._extent)
        self._roadmaps: dict[tuple[str, ...], Roadmap] = {}

    def _between(self, row: int, start: Array, goal: Array, request: PathRequest) -> PlannedPath:
        return self._without(request.closed).path(start, goal, self.parameters.most_nodes)

    def _without(self, closed: tuple[str, ...]) -> Roadmap:
        """Return the roadmap without some regions."""
        if not closed:
            return self._roadmap
        if closed not in self._roadmaps:
            roadmap, space, regions = self._roadmap, self._space, self._regions(closed)
            points, ends = roadmap.points, roadmap.points[roadmap.edges]
            open_edges = space.outside(ends[:, 0], ends[:, 1], regions)
            self._roadmaps[closed] = roadmap.without(open_edges, space.outside(points, points, regions))
        return self._roadmaps[closed]
