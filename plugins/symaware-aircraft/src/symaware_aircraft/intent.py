"""Intents of other aircraft, from the waypoints that they send or by assumption."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_aircraft.dubins import DubinsPath, Sampling, shortest_path
from symaware_aircraft.prediction import as_pose, check_poses, rollout
from symaware_cli import (
    Agent,
    AgentGroup,
    AwarenessDatabase,
    CommunicationReceiver,
    CommunicationSender,
    KnowledgeDatabase,
    Message,
    Parameters,
    TimeSeries,
    nanoseconds,
    seconds,
)

Array = NDArray[np.float64]


class TellWaypoint(CommunicationSender):
    """Sends its waypoint and its present state to all other agents."""

    knowledge: ClassVar = {"waypoint": "where to fly, as x [m], y [m] and heading [rad]"}

    class Parameters(Parameters):
        """The period."""

        period: float = Field(10.0, ge=0, description="Simulated time between two messages to the same agent [s].")

    _due = 0

    def check(self, group: AgentGroup) -> None:
        """Check that the waypoint is a pose."""
        check_poses(group, "waypoint")

    def _compute(self) -> Iterable[Message]:
        if self.now < self._due:
            return ()
        agent = self.agent
        payload = {"waypoint": agent.self_knowledge["waypoint"], "state": agent.self_state}
        others = (id for id in self.environment.roster.ids if id != agent.id)
        return [Message(agent.id, other, payload, kind="waypoint") for other in others]

    def _update(self, value: Iterable[Message]) -> None:
        super()._update(value)
        if value:
            self._due = self.now + nanoseconds(self.parameters.period)


class _FlightPlan(NamedTuple):
    """The assumed flight of another agent: a path to a waypoint, with its start time [ns]."""

    waypoint: tuple[float, ...]
    begun: int
    path: DubinsPath


class Intent(CommunicationReceiver):
    """Estimates the intents of others: the Dubins path to the waypoint that they sent, else straight flight.

    With the source ``communication``, a message of `aircraft.tell-waypoint` yields a flight plan: the shortest path
    from the sender's position when it sent the message. A message is read a step after it was sent. Intents that are
    known from the start are given as knowledge, like filed flight plans: `waypoints`, a mapping from ids to poses, in
    which messages replace waypoints. Without a waypoint, and with the source ``straight``, straight flight is assumed.

    It updates the awareness of others with their intent: poses from their perceived present pose, one for each step of
    the world. If a perception supplies motions only, others are assumed to head along their velocity.
    """

    class Parameters(Parameters):
        """Assumptions about others."""

        source: Literal["communication", "straight"] = Field(
            "communication",
            description="Source of intents: messages of others, or the assumption of straight flight.",
        )
        speed: float = Field(10.0, gt=0, description="Speed at which others fly [m/s].")
        turn_rate: float = Field(0.07, gt=0, description="Turn rate of their planned arcs, to either side [rad/s].")
        horizon: int = Field(30, ge=1, le=10_000, description="Length of an intent, in steps of the world.")
        sampling: Sampling = Field(
            "mean", description="How turn rates follow from the path; see `symaware show aircraft.dubins`."
        )

    def check(self, group: AgentGroup) -> None:
        """Check that waypoints known from the start are poses."""
        for knowledge in group.knowledge:
            for id, waypoint in _filed(knowledge).items():
                as_pose(waypoint, f"the waypoint of `{id}`")

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Start without flight plans; known ones are made when the agent is first perceived."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        self._step = seconds(self.environment.time_step)
        self._plans: dict[str, _FlightPlan] = {}

    def _update(self, value: Sequence[Message]) -> None:
        if self.parameters.source == "communication":
            for message in value:
                if message.kind == "waypoint":
                    self._hear(message)
        database = self.agent.awareness_database
        for id in [id for id in database if id != self.agent.id]:
            world = database.world
            if world is not None and id in world.roster:
                motion, pose = world.motion(id), as_pose(world.state(id), f"the perceived state of `{id}`")
            else:
                perceived = database.perceived(id)
                motion = database[id].state if perceived is None else perceived
                pose = _course_of(motion)
            database[id].state = motion
            database[id].intent = self._intent(id, pose)

    def _hear(self, message: Message) -> None:
        """Make a flight plan from a message, unless the waypoint is unchanged."""
        sender, waypoint = message.sender, message.payload["waypoint"]
        told = as_pose(waypoint, f"the waypoint sent by {sender}")
        plan = self._plans.get(sender)
        if plan is None or plan.waypoint != tuple(told.tolist()):
            self._plan(sender, told, message.payload["state"], message.sent_time)
            knowledge = self.agent.self_knowledge
            knowledge["waypoints"] = {**_filed(knowledge), sender: told.tolist()}

    def _plan(self, id: str, waypoint: Array, state: Array, begun: int) -> _FlightPlan:
        parameters = self.parameters
        path = shortest_path(state, waypoint, parameters.speed / parameters.turn_rate)
        plan = self._plans[id] = _FlightPlan(tuple(waypoint.tolist()), begun, path)
        return plan

    def _intent(self, id: str, pose: Array) -> TimeSeries:
        """Return the future poses of an agent perceived at a pose."""
        parameters = self.parameters
        turn_rates = np.zeros(parameters.horizon)
        plan = self._plans.get(id)
        filed = _filed(self.agent.self_knowledge).get(id) if parameters.source == "communication" else None
        if filed is not None:
            waypoint = as_pose(filed, f"the waypoint of `{id}`")
            if plan is None or plan.waypoint != tuple(waypoint.tolist()):
                plan = self._plan(id, waypoint, pose, self.now)
        if plan is not None:
            passed = (self.now - plan.begun) // self.environment.time_step
            ahead = plan.path.turn_rates(
                parameters.speed, self._step, parameters.sampling, begin=passed, count=parameters.horizon
            )
            turn_rates[: len(ahead)] = ahead
        poses = rollout(pose, parameters.speed, turn_rates[None], self._step)[0]
        return TimeSeries.sampled(self.now + np.arange(len(poses)) * self.environment.time_step, poses)


def _course_of(motion: Array) -> Array:
    """Return a pose with the heading along the velocity, from x [m], y [m], vx [m/s] and vy [m/s]."""
    x, y, vx, vy = motion
    return np.array([x, y, np.arctan2(vy, vx)])


def _filed(knowledge: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the known waypoints by id."""
    waypoints = knowledge.get("waypoints")
    if waypoints is None:
        return {}
    if not isinstance(waypoints, Mapping):
        raise ValueError("`waypoints` must be a mapping from ids to x [m], y [m] and heading [rad]")
    return waypoints
