"""Flight along a Dubins path without feedback, with turn noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_aircraft.dubins import DubinsPath, Sampling, shortest_path
from symaware_aircraft.prediction import POSE, as_pose, check_aircraft, check_poses, rollout
from symaware_cli import (
    Agent,
    AgentGroup,
    AwarenessDatabase,
    Controller,
    KnowledgeDatabase,
    Parameters,
    Quantity,
    TimeSeries,
    seconds,
)

Array = NDArray[np.float64]

#: The greatest number of steps of an intent.
_FARTHEST = 10_000


class _Flight(NamedTuple):
    """A planned flight: a path to a waypoint, with its start time [ns]."""

    waypoint: Array
    begun: int
    path: DubinsPath


class DubinsFlight(Controller):
    """Flies the shortest Dubins path to its waypoint at a constant speed, and straight on after it.

    The turn rates are planned once for each waypoint, from the state believed when the waypoint becomes known, and
    flown without feedback; the effects of `turn_noise` and `turn_bias` are not corrected. The intent is the path under
    the planned turn rates from the present state, for at most 10,000 steps.
    """

    knowledge: ClassVar = {"waypoint": "where to fly, as x [m], y [m] and heading [rad]"}

    class Parameters(Parameters):
        """Speed, turn rate and noise."""

        speed: float = Field(10.0, gt=0, description="Speed [m/s].")
        turn_rate: float = Field(0.07, gt=0, description="Turn rate of the planned arcs, to either side [rad/s].")
        sampling: Sampling = Field(
            "mean",
            description="How turn rates follow from the path: `mean` keeps its heading at every step; `recorded` turns "
            "in whole steps, as the published runs of the case study did.",
        )
        turn_noise: float = Field(
            0.0, ge=0, description="Greatest random change of the turn rate in a step, to either side [rad/s]."
        )
        turn_bias: float = Field(0.0, description="Constant that is added to the turn rate in every step [rad/s].")

    def check(self, group: AgentGroup) -> None:
        """Check that the agents are aircraft, and that the waypoint is a pose."""
        check_aircraft(group)
        check_poses(group, "waypoint")

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """Declare the intent as a series of poses."""
        return {"intent": POSE}

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Plan the flight."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        self._step = seconds(self.environment.time_step)
        self._flight = self._planned(as_pose(agent.self_knowledge["waypoint"], "`waypoint`"))

    def _planned(self, waypoint: Array) -> _Flight:
        """Return the flight from the present state to a waypoint."""
        parameters = self.parameters
        path = shortest_path(self.agent.self_state, waypoint, parameters.speed / parameters.turn_rate)
        return _Flight(waypoint, self.now, path)

    def _compute(self) -> tuple[Array, TimeSeries, _Flight]:
        parameters, flight = self.parameters, self._flight
        waypoint = as_pose(self.agent.self_knowledge["waypoint"], "`waypoint`")
        if not np.array_equal(waypoint, flight.waypoint):
            flight = self._planned(waypoint)
        passed = (self.now - flight.begun) // self.environment.time_step
        planned = flight.path.turn_rates(
            parameters.speed, self._step, parameters.sampling, begin=passed, count=_FARTHEST
        )
        if not len(planned):
            planned = np.zeros(1)
        turn_rate = planned[0] + parameters.turn_bias
        if parameters.turn_noise:
            turn_rate += self.random.uniform(-parameters.turn_noise, parameters.turn_noise)
        poses = rollout(self.agent.self_state, parameters.speed, planned[None], self._step)[0]
        times = self.now + np.arange(len(poses)) * self.environment.time_step
        return np.array([parameters.speed, turn_rate]), TimeSeries.sampled(times, poses), flight

    def _update(self, value: tuple[Array, TimeSeries, _Flight]) -> None:
        control_input, intent, self._flight = value
        super()._update((control_input, intent))
