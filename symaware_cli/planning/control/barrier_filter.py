"""A filter that makes any controller keep distances, by control barrier functions."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup, Confined, Level, Quantity, ScenarioView, Signal, Tracks
from symaware_cli.engine import (
    RequestFilter,
    ScanOptions,
    ScanReturns,
    ScanSurfaces,
    bounding_radii,
    check_scan,
    dot,
)
from symaware_cli.geometry import Array, Indices, separation_from_points
from symaware_cli.planning.control.barriers import (
    Encounters,
    PointMotion,
    greatest_length,
    kind_of_motion,
    motion_of,
)
from symaware_cli.planning.optimal_control.qp import solve_qp
from symaware_cli.world import SECOND, nanoseconds

#: By how much a request may violate a constraint without being changed [m/s or m/s^2].
_TOLERANCE = 1e-9
#: Costs of relaxing constraints of other agents and of obstacles, which do not move aside.
_PRICE_OF_AGENT, _PRICE_OF_OBSTACLE = 1e4, 1e6
#: Parts of the limits of control inputs that are tried, as the margin of a unicycle is less if it is slow.
_PARTS = (1.0, 0.5, 0.25, 0.125, 0.0)


class Filtering(NamedTuple):
    """The result of a turn for an agent whose request violates a constraint.

    Attributes:
        body: The body whose constraint it violates most.
        relaxed: The body whose constraint was relaxed most; None if all are satisfied.
        slack: The amount by which it was relaxed [m/s or m/s^2].
    """

    body: str
    relaxed: str | None
    slack: float


class BarrierFilter(RequestFilter):
    """Changes the motion requested by the preceding controller as little as keeps distances to others and obstacles.

    Declare it after any controller. Each distance has a control barrier function h, the distance of two bodies minus
    the margin, and a linear constraint on the control input, so that h decreases by at most the part ``gain`` in a
    second and never becomes negative. A quadratic program finds the allowed control input closest to the requested one
    (`symaware_cli.planning.optimal_control.qp`; the extra ``qp``). The mathematics is in `barriers`.

    It supports single integrators, double integrators with a greatest acceleration, and unicycles, in the plane. For a
    unicycle it keeps the distances of the point ``ahead`` of its axle, with a disc around it that contains its body.
    Agents of the same kind of model are expected to use the same filter with the same parameters, and take half of each
    constraint; other agents and obstacles to keep their velocities.

    Of another that is known to stay in a set, as from a promise, an agent keeps the distance from the other, or from
    the set that the other's body may fill: of both constraints that which its request violates less, as either
    suffices.

    If the constraints contradict each other, or the limits of the control input, they are relaxed, those of obstacles
    last. The intent stays that of the controller.
    """

    batchable = True

    sees_world = True

    events: ClassVar = {
        "filtered": "An agent began to move otherwise than requested, because of `body`.",
        "infeasible": "The distances cannot all be kept: that to `relaxed` by a `slack` less [m/s, or m/s^2 for double"
        " integrators].",
        "held-too-long": "The control input was held for longer than the filter assumes, `hold`: distances may not be"
        " kept; fired once.",
    }

    signals: ClassVar = (
        Signal(
            "barrier",
            columns=[Quantity("barrier", "m")],
            description="least barrier function of any distance; the reach if nothing is near",
        ),
    )

    class Parameters(ScanOptions):
        """Distances, and how fast they may be used up."""

        scan: str | None = Field(
            None,
            description="The name of the lidar that sees the obstacles, which are expected to stand still; null for "
            "agents that know them. Then `gain` should be at most half of the rate of its scans.",
        )
        margin: float = Field(0.0, ge=0, description="Distance to keep between bodies, which are taken for discs [m].")
        gain: float = Field(
            1.0,
            gt=0,
            description="The part of the remaining distance that may be used up in a second [1/s]. At most the inverse"
            " of `hold` has an effect. For double integrators it should be at most the greatest acceleration"
            " over the greatest speed, so that two can always brake in time.",
        )
        reach: float = Field(5.0, gt=0, description="Others and surfaces farther away are not considered [m].")
        cooperative: bool = Field(
            True,
            description="Whether others with the same kind of model use the same filter, so that each does half. If"
            " not, others are expected to keep their velocities.",
        )
        hold: float | None = Field(
            None,
            gt=0,
            description="For how long a control input is held [s]: the component's `period`, if it has one; the time"
            " step of the world if null.",
        )
        ahead: float = Field(
            0.1,
            gt=0,
            description="How far the point of a unicycle is ahead of its axle [m]; it cannot move aside at 0.",
        )
        sidestep: float = Field(
            1.0,
            ge=0,
            description="Agents in each other's way also turn off to the right, by this for each m/s (m/s^2 for double"
            " integrators) that they may not approach: without, symmetric encounters end in a standstill. 0 for not at"
            " all.",
        )

    def check(self, group: AgentGroup) -> None:
        """Check that the model is supported, and that its control inputs are limited where that is needed."""
        model, kind = group.model, kind_of_motion(group.model)
        if kind is None:
            raise ValueError(
                "it supports single integrators, double integrators and unicycles in the plane, and not a model with"
                f" the control inputs {', '.join(name for name, _ in model.control_input)}"
            )
        if len(model.state) == 3 and model.input_bounds()[0][0] > 0.0:
            raise ValueError("it needs a unicycle that can stand still, with `min_speed` at most 0")
        if len(model.state) == 4 and not np.isfinite(greatest_length(model)):
            raise ValueError("it needs a double integrator with a greatest acceleration, `max_acceleration`")

    def check_scenario(self, view: ScenarioView) -> None:
        """Check that the scan exists."""
        check_scan(view, self.parameters.scan)

    def initialise_component(self, group: AgentGroup) -> None:
        """Look up the sizes and models of all agents."""
        super().initialise_component(group)
        environment, parameters = self.environment, self.parameters
        own = kind_of_motion(group.model)
        hold = environment.time_step if parameters.hold is None else nanoseconds(parameters.hold)
        self._hold = hold
        self._motion = motion_of(group, parameters.gain, hold / SECOND, parameters.ahead)
        self._radii = bounding_radii(environment)
        keep = group.entity.radius + self._motion.ahead + parameters.margin
        self._surfaces = None if parameters.scan is None else ScanSurfaces(parameters.scan, parameters, keep)
        same = [parameters.cooperative and kind_of_motion(each.model) is own for each in environment.groups]
        #: Whether each agent does its half, by index in the roster; shape (N,).
        self._shares = np.repeat(np.array(same, bool), [len(each) for each in environment.groups])
        self._filtering = np.zeros(len(group), bool)
        self._relaxing = np.zeros(len(group), bool)
        self._last: int | None = None
        self._warned = False

    def _compute(self) -> tuple[Array, Array, Array, dict[int, Filtering], ScanReturns | None]:
        state, requested, motion = self._group.awareness.state, self._request(), self._motion
        returns = None if self._surfaces is None else self._surfaces.returns(self._group, self.now)
        encounters, bodies, tracks = self._encounters(state, returns)
        barrier = np.full(len(self._group), self.parameters.reach)
        np.minimum.at(barrier, encounters.row, encounters.barrier)
        for confined in self._group.confined(tracks):
            encounters = self._relying(encounters, tracks, confined, state, requested)
        rows, least = motion.along(encounters.normal, encounters.row, state), motion.limit(encounters, state)
        allowed = self._group.model.limit(requested)
        control_input, changes = requested, {}
        lacking = least + motion.margin - dot(rows.T, allowed.take(encounters.row, 0).T)
        # No allowed input violates the others.
        relevant = least + motion.margin > -motion.fastest(rows)
        violating = np.unique(encounters.row[lacking > _TOLERANCE])
        if len(violating):
            control_input = requested.copy()
            for agent in violating.tolist():
                own = np.flatnonzero(relevant & (encounters.row == agent))
                wanted = allowed[agent]
                worst = own[lacking[own].argmax()]
                if bodies[worst] < len(self._radii):
                    x, y = encounters.normal[:, worst].tolist()
                    aside = motion.along(np.array([[-y], [x]]), encounters.row[[worst]], state)[0]
                    wanted = wanted + self.parameters.sidestep * lacking[worst] * aside / np.diagonal(motion.metric)
                prices = np.where(bodies[own] < len(self._radii), _PRICE_OF_AGENT, _PRICE_OF_OBSTACLE)
                control_input[agent], slacks = nearest_input(motion, wanted, rows[own], least[own], prices)
                most = int(slacks.argmax())
                relaxed = self._name(bodies[own[most]]) if slacks[most] > _TOLERANCE else None
                changes[agent] = Filtering(self._name(bodies[worst]), relaxed, float(slacks[most]))
        return requested, control_input, barrier, changes, returns

    def _update(self, value: tuple[Array, Array, Array, dict[int, Filtering], ScanReturns | None]) -> None:
        requested, control_input, barrier, changes, returns = value
        if self._surfaces is not None and returns is not None:
            self._surfaces.remember(self._group, self.computed_at, returns)
        self._replace(requested, control_input)
        self.record(self.signals[0], barrier[:, None])
        filtering, relaxing = np.zeros(len(barrier), bool), np.zeros(len(barrier), bool)
        for agent, change in sorted(changes.items()):
            filtering[agent], relaxing[agent] = True, change.relaxed is not None
            least = float(barrier[agent])
            if not self._filtering[agent]:
                text = f"moves otherwise than requested, because of {change.body}"
                self.emit_for(agent, "filtered", text, body=change.body, barrier=least)
            if change.relaxed is not None and not self._relaxing[agent]:
                text = (
                    f"cannot keep all distances: the constraint of {change.relaxed} was relaxed by {change.slack:.2g}"
                )
                facts = {"relaxed": change.relaxed, "slack": change.slack, "barrier": least}
                self.emit_for(agent, "infeasible", text, level=Level.WARNING, **facts)
        self._filtering, self._relaxing = filtering, relaxing
        if self._last is not None and self.computed_at - self._last > self._hold and not self._warned:
            held = (self.computed_at - self._last) / SECOND
            text = f"control inputs are held for {held:g} s, and `hold` is {self._hold / SECOND:g} s"
            self.emit("held-too-long", text, level=Level.WARNING, held=held)
            self._warned = True
        self._last = self.computed_at

    def _name(self, body: int) -> str:
        """Return the name of a body: an agent by its index, or an obstacle by its index after all agents."""
        count = len(self._radii)
        if body >= count and self._surfaces is not None:
            return f"what {self._surfaces.scan} sees"
        return self.environment.roster.ids[body] if body < count else self.environment.scenery.names[body - count]

    def _encounters(self, state: Array, returns: ScanReturns | None) -> tuple[Encounters, Indices, Tracks]:
        """Return the bodies within reach, which they are (see `_name`), shape (m,), and the tracks of the first."""
        group, parameters, motion = self._group, self.parameters, self._motion
        position = group.model.positions(state)
        own = motion.points(state, position)
        tracks = group.others(parameters.reach)
        if self._surfaces is not None and returns is not None:
            near = self._surfaces.nearest(group, returns, own, parameters.reach, self._radii)
        else:
            near = self.environment.scenery.nearest(own, parameters.reach)
        others, shared = tracks.others, self._shares.take(tracks.others)
        points = tracks.positions[:, :2] + np.where(shared, motion.ahead, 0.0)[:, None] * self._directions(tracks)
        keep = group.entity.radius + motion.ahead + parameters.margin
        apart = own.take(tracks.observers, 0) - points
        away = own.take(near.row, 0) - near.point
        distance = np.sqrt(dot(apart.T, apart.T))
        encounters = Encounters(
            row=np.concatenate([tracks.observers, near.row]),
            # Within an obstacle the distance is negative, so the normal points to the nearest way out.
            normal=_directed(np.concatenate([apart, away]), np.concatenate([distance, near.distance])),
            distance=np.concatenate([distance, near.distance]),
            keep=np.concatenate(
                [keep + self._radii.take(others) + np.where(shared, motion.ahead, 0.0), np.full(len(near.row), keep)]
            ),
            velocity=np.ascontiguousarray(np.concatenate([tracks.velocities[:, :2], near.velocity]).T),
            shared=np.concatenate([shared, np.zeros(len(near.row), bool)]),
        )
        return encounters, np.concatenate([others, len(self._radii) + near.obstacle]), tracks

    def _relying(
        self, encounters: Encounters, tracks: Tracks, confined: Confined, state: Array, requested: Array
    ) -> Encounters:
        """Return encounters with the sets of others in place of those with others, where the request violates less.

        The barrier of such a set is that of an obstacle that stands still. As long as it is kept, the other is not met,
        whatever it does within its set; so at each instant either of both constraints may be kept. Of an agent that is
        already nearer to the set than that, the constraint of the other counts.
        """
        group, motion = self._group, self._motion
        rows, observers = confined.rows, tracks.observers.take(confined.rows)
        own = motion.points(state, group.model.positions(state)).take(observers, 0)
        found = separation_from_points(own, np.zeros(len(own)), confined.sets)
        away = own - found.second
        keep = group.entity.radius + motion.ahead + self.parameters.margin
        standing = Encounters(
            row=observers,
            normal=_directed(away, found.distance),
            distance=found.distance,
            keep=keep + self._radii.take(tracks.others.take(rows)),
            velocity=np.zeros((2, len(rows))),
            shared=np.zeros(len(rows), bool),
        )
        allowed = group.model.limit(requested)
        lacking = []
        for each in (encounters, standing):
            along = motion.along(each.normal, each.row, state)
            needed = motion.limit(each, state) + motion.margin
            lacking.append(needed - dot(along.T, allowed.take(each.row, 0).T))
        # A loop, as several sets may be about one other: the one that the request violates least is used.
        best = lacking[0].copy()
        parts = {name: getattr(encounters, name).copy() for name in Encounters.__slots__}
        for place in np.flatnonzero(standing.barrier >= 0.0).tolist():
            row = int(rows[place])
            if lacking[1][place] < best[row]:
                best[row] = lacking[1][place]
                for name, part in parts.items():
                    part[..., row] = getattr(standing, name)[..., place]
        return Encounters(**parts)

    def _directions(self, tracks: Tracks) -> Array:
        """Return the directions in which others look: of omniscient agents as it is, else that of their velocity."""
        if not self._motion.ahead:
            return np.zeros((len(tracks.others), 2))
        world = self._group.awareness.world
        if self._group.awareness.tracks is None and world is not None:
            heading = world.headings.take(tracks.others)
            return np.stack([np.cos(heading), np.sin(heading)], axis=1)
        velocity = tracks.velocities[:, :2]
        return _directed(velocity, np.sqrt(dot(velocity.T, velocity.T))).T


def nearest_input(motion: PointMotion, wanted: Array, rows: Array, least: Array, prices: Array) -> tuple[Array, Array]:
    """Return the control input nearest to a wanted one that satisfies constraints.

    Args:
        motion: The metric, and the limits of control inputs.
        wanted: The wanted one; shape (nu,).
        rows: Rows a of the constraints a . u >= b; shape (m, nu).
        least: Their b; shape (m,).
        prices: The price of relaxing each constraint, if they contradict each other; shape (m,).

    Returns:
        The control input, shape (nu,), and the amount by which each constraint was relaxed; shape (m,).
    """
    sides, most = motion.limits
    linear, matrix = -(motion.metric @ wanted), np.concatenate([rows, sides])
    unbounded, hard = np.full(len(most), -np.inf), np.full(len(most), np.inf)
    upper = np.concatenate([np.full(len(least), np.inf), most])
    for part in _PARTS if motion.margin else _PARTS[:1]:
        lower = np.concatenate([least + part * part * motion.margin, unbounded])
        upper[len(least) :] = part * most
        solution = solve_qp(motion.metric, linear, matrix, lower, upper)
        if solution.solved:
            return solution.x, np.zeros(len(least))
    lower, upper[len(least) :] = np.concatenate([least, unbounded]), most
    solution = solve_qp(motion.metric, linear, matrix, lower, upper, prices=np.concatenate([prices, hard]))
    if not solution.solved:
        raise RuntimeError(f"the quadratic program of a barrier filter is {solution.status}, though it may be relaxed")
    return solution.x, solution.slacks[: len(least)]


def _directed(vectors: Array, length: Array) -> Array:
    """Return unit vectors in columns, shape (2, m), from vectors (m, 2) over lengths (m,); 0 for length 0."""
    scale = 1.0 / np.where(length == 0.0, np.inf, length)
    return np.stack([vectors[:, 0] * scale, vectors[:, 1] * scale])
