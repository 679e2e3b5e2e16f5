"""Reciprocal collision avoidance (ORCA): velocities that avoid other agents that do likewise.

Reasons: docs/decisions/0010-velocity-obstacles.md
"""

from __future__ import annotations

import numpy as np
from pydantic import Field, model_validator

from symaware_cli.core import AgentGroup, ScenarioView
from symaware_cli.engine.components.control.goal import GoalSeeking
from symaware_cli.engine.components.control.half_planes import HalfPlanes, nearest_velocity
from symaware_cli.engine.components.control.steering import along, approach
from symaware_cli.engine.components.relative_motion import RelativeMotion, bounding_radii, dot, own_velocity
from symaware_cli.engine.components.scan_surfaces import ScanOptions, ScanReturns, ScanSurfaces, check_scan
from symaware_cli.geometry import Array, Indices

#: How much constraints of obstacles yield, relative to agents, if infeasible: obstacles do not move aside.
_OBSTACLE_WEIGHT = 0.01


def reciprocal_constraints(
    apart: Array, closing: Array, own: Array, radius: Array, horizon: float, parting: float, share: float
) -> tuple[Array, Array]:
    """Return half-planes of velocities in which two agents avoid each other if both stay in theirs.

    The velocity obstacle is the set of relative velocities that lead to a collision within the horizon: a cone
    truncated by a disc. The half-plane touches it at its point closest to the present relative velocity, after the
    agent's share of the way there (J. van den Berg, S. J. Guy, M. Lin, D. Manocha, "Reciprocal n-body collision
    avoidance", Robotics Research, STAR 70, 2011, section 4).

    Args:
        apart: The vector from the agent to the other [m]; shape (2, m).
        closing: The velocity of the other minus that of the agent [m/s]; shape (2, m).
        own: The velocity of the agent [m/s]; shape (2, m).
        radius: The sum of the radii [m]; shape (m,).
        horizon: For how long to avoid a collision [s].
        parting: The time in which bodies that overlap separate [s].
        share: The agent's share of the change of the relative velocity.

    Returns:
        Unit normals, shape (2, m), and limits, shape (m,): an allowed velocity v has n . v <= c.
    """
    square = dot(apart, apart)
    overlapping = square <= radius * radius
    time = np.where(overlapping, parting, horizon)
    # From the centre of the truncating disc to the relative velocity.
    tip = -closing - apart / time
    tip_square = dot(tip, tip)
    inward = dot(tip, apart)
    at_disc = overlapping | ((inward < 0.0) & (inward * inward > radius * radius * tip_square))
    # Away from the disc; straight back if the velocity is at its centre.
    tip_length = np.sqrt(tip_square)
    centred = tip_length <= 1e-9
    away = np.where(centred, -apart, tip) / np.where(centred, np.sqrt(square), tip_length)
    # Away from the leg of the cone on the same side.
    leg = np.sqrt(np.maximum(square - radius * radius, 0.0))
    side = np.where(apart[0] * tip[1] - apart[1] * tip[0] > 0.0, 1.0, -1.0)
    across = np.stack([-side * apart[1] * leg - apart[0] * radius, side * apart[0] * leg - apart[1] * radius])
    across /= np.where(overlapping, 1.0, square)
    normal = -np.where(at_disc, away, across)
    inside = np.where(at_disc, radius / time - tip_length, dot(closing, across))
    return normal, dot(normal, own) - share * inside


class VelocityObstacle(GoalSeeking):
    """Moves to the position ``goal``, and avoids obstacles and other agents that do likewise.

    Optimal reciprocal collision avoidance (ORCA; see `reciprocal_constraints`): each agent takes the velocity closest
    to the one straight to its goal that avoids, for the time horizon, all agents that it is aware of, provided that
    they do their half. If that is impossible it takes the velocity that violates these constraints least. Each agent
    uses its own beliefs without regard to their uncertainty: an agent that is not perceived is not avoided. Each convex
    piece of an obstacle forbids the velocities that would cover the distance to it within a horizon of its own; the
    agents know the obstacles, or see them by a lidar (`scan`); then others that they are not aware of are obstacles
    as well.

    While there is anything to avoid, each agent turns a little to the right of its goal. If all agents move straight to
    the same place, as on a circle, reciprocal avoidance alone ends in a deadlock that no small random change resolves;
    keeping right makes it a roundabout.

    Constraints hold for velocities that are followed exactly, from one step to the next. ``margin`` covers the
    deviations of a model (a unicycle turns before it rolls) and the motion within a step. Heights are ignored. The
    intent is the velocity over the horizon.
    """

    batchable = True

    sees_world = True

    class Parameters(GoalSeeking.Parameters, ScanOptions):
        """Parameters of avoidance."""

        scan: str | None = Field(
            None, description="The name of the lidar that sees the obstacles; null for agents that know them."
        )
        max_speed: float | None = Field(
            None, gt=0, description="Greatest speed while avoiding, at least the cruise speed [m/s]; that if null."
        )
        time_horizon: float = Field(2.0, gt=0, description="For how long to keep clear of other agents [s].")
        time_horizon_obstacles: float = Field(
            1.0, gt=0, description="In what time an agent may at most use up its distance to an obstacle [s]."
        )
        margin: float = Field(0.2, ge=0, description="Distance to keep from other bodies [m].")
        neighbours: int = Field(10, ge=1, le=1000, description="How many others to avoid at most; the nearest count.")
        reach: float = Field(10.0, gt=0, description="Others farther away are not avoided [m].")
        responsibility: float = Field(
            0.5,
            gt=0,
            le=1,
            description="The part of each avoidance to take upon oneself; 1 among those who do not avoid.",
        )
        parting: float = Field(
            0.25, gt=0, description="In what time to restore the margin where it is used up [s]; less is more abrupt."
        )
        perturbation: float = Field(
            0.2,
            ge=0,
            lt=1.5,
            description="Who is near anybody or anything turns off to the right by an angle of its own, drawn from half"
            " of this to all of it [rad]: without, symmetric encounters end in a standstill. 0 for not at all.",
        )

        @model_validator(mode="after")
        def _faster_than_cruising(self) -> VelocityObstacle.Parameters:
            if self.max_speed is not None and self.max_speed < self.speed:
                raise ValueError(f"max_speed ({self.max_speed:g}) must not be less than speed ({self.speed:g})")
            return self

    def check(self, group: AgentGroup) -> None:
        """Check that agents move in the plane."""
        if len(group.model.position) != 2:
            raise ValueError("avoidance works in the plane, and the model moves in space")
        super().check(group)

    def check_scenario(self, view: ScenarioView) -> None:
        """Check that the scan exists."""
        check_scan(view, self.parameters.scan)

    def initialise_component(self, group: AgentGroup) -> None:
        """Look up the sizes of all agents."""
        super().initialise_component(group)
        given = self.parameters
        self._surfaces = (
            None if given.scan is None else ScanSurfaces(given.scan, given, group.entity.radius + given.margin)
        )
        self._radii = bounding_radii(self.environment)
        #: The angle by which each agent turns to the right [rad]; shape (n,).
        self._turn: Array | None = None
        if self.parameters.perturbation:
            self._turn = self.parameters.perturbation * (0.5 + 0.5 * self.random.uniform(1)[:, 0])

    def _compute(self) -> tuple[Array, Array, Array, Array, ScanReturns | None]:
        model, state, goal = self._group.model, self._group.awareness.state, self._goals(self._group)
        position, given = model.positions(state), self.parameters
        distance, _, _, preferred = approach(goal, position, given.speed, given.gain)
        relative = RelativeMotion(self._group, self.parameters.reach, self._radii, own_velocity(self._group))
        returns = None if self._surfaces is None else self._surfaces.returns(self._group, self.now)
        planes = _joined(self._obstacle_planes(position, returns), self._agent_planes(relative))
        if self._turn is not None and planes.limit.shape[1]:
            avoiding = np.isfinite(planes.limit).any(axis=1)
            preferred = _turned_right(preferred, np.where(avoiding, self._turn, 0.0))
        velocity, _ = nearest_velocity(planes, preferred, self._greatest_speed)
        intent = along(position, velocity, np.broadcast_to(self._ahead, (len(position), len(self._ahead))))
        return model.follow_velocity(state, velocity), intent, goal, distance, returns

    def _update(self, value: tuple[Array, Array, Array, Array, ScanReturns | None]) -> None:
        control_input, intent, goal, distance, returns = value
        self._steer(control_input, intent)
        if self._surfaces is not None and returns is not None:
            self._surfaces.remember(self._group, self.computed_at, returns)
        self._emit_arrivals(goal, distance)

    @property
    def _greatest_speed(self) -> float:
        """The maximum speed while avoiding [m/s]."""
        greatest: float | None = self.parameters.max_speed
        return float(self.parameters.speed if greatest is None else greatest)

    def _agent_planes(self, relative: RelativeMotion) -> HalfPlanes:
        parameters = self.parameters
        observers, apart = relative.observers, relative.apart[:2]
        rows = _nearest(relative.tracks.pointers, observers, dot(apart, apart), parameters.neighbours)
        observers = observers[rows]
        normal, limit = reciprocal_constraints(
            apart[:, rows],
            relative.closing[:2, rows],
            np.ascontiguousarray(relative.velocity[observers].T),
            relative.radius[rows] + parameters.margin,
            parameters.time_horizon,
            parameters.parting,
            parameters.responsibility,
        )
        return _padded(len(self._group), observers, normal, limit, 1.0)

    def _obstacle_planes(self, position: Array, returns: ScanReturns | None) -> HalfPlanes:
        parameters, scenery = self.parameters, self.environment.scenery
        keep = self._group.entity.radius + parameters.margin
        reach = keep + self._greatest_speed * parameters.time_horizon_obstacles
        if self._surfaces is not None and returns is not None:
            near = self._surfaces.nearest(self._group, returns, position, reach, self._radii)
        else:
            near = scenery.nearest(position, max(reach, parameters.reach) if scenery.moves else reach)
        distance = near.distance
        # Inside of an obstacle the distance is negative, so the normal points to the nearest way out.
        normal = ((near.point - position[near.row]) / np.where(distance == 0.0, np.inf, distance)[:, None]).T
        limit = (distance - keep) / parameters.time_horizon_obstacles + dot(normal, near.velocity.T)
        limit = np.where(distance == 0.0, np.inf, limit)
        return _padded(len(position), near.row, normal, limit, _OBSTACLE_WEIGHT)


def _turned_right(vectors: Array, angle: Array) -> Array:
    """Turn vectors (n, 2) clockwise by angles (n,)."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.stack([cosine * x + sine * y, cosine * y - sine * x], axis=1)


def _nearest(pointers: Indices, observers: Indices, square: Array, most: int) -> Indices:
    """Return the rows of the nearest others of each agent, in their original order.

    Args:
        pointers: The first row of each agent; shape (n + 1,).
        observers: The agent of each row; shape (m,).
        square: The squared distance of each row; shape (m,).
        most: The number of others to keep for each agent.
    """
    if not len(square) or np.diff(pointers).max() <= most:
        return np.arange(len(square))
    order = np.lexsort((square, observers))
    rank = np.arange(len(order)) - pointers[:-1][observers]
    return np.sort(order[rank < most])


def _padded(count: int, rows: Indices, normal: Array, limit: Array, weight: float) -> HalfPlanes:
    """Arrange constraints, given in the order of the agents, in one row for each agent."""
    starts = np.searchsorted(rows, np.arange(count))
    column = np.arange(len(rows)) - starts[rows]
    width = int(column.max(initial=-1)) + 1
    x, y, limits = np.zeros((count, width)), np.zeros((count, width)), np.full((count, width), np.inf)
    x[rows, column], y[rows, column], limits[rows, column] = normal[0], normal[1], limit
    return HalfPlanes(x, y, limits, np.full((count, width), weight))


def _joined(first: HalfPlanes, second: HalfPlanes) -> HalfPlanes:
    if not first.limit.shape[1]:
        return second
    return HalfPlanes(*(np.concatenate(pair, axis=1) for pair in zip(first, second, strict=True)))
