"""A controller that drives from cell to cell, at speeds from which a body can still stop in time."""

from __future__ import annotations

from collections.abc import Collection
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup, Contact, Drive, Event, Level, ScenarioView
from symaware_cli.engine import Steering
from symaware_cli.geometry import Array, Mask, lengths, wrapped
from symaware_cli.knowledge.abstraction.knowledge_model import model_named
from symaware_cli.knowledge.components.cell_certificate import CellCheck
from symaware_cli.world import ParameterError, seconds

#: How often an interval of speeds is halved: until nothing of it is left in double precision.
_HALVINGS = 60
#: The greatest angle between the heading and the way ahead at which a vehicle drives [rad].
_ALIGNED = 1e-3
#: How far from the middle of a side an agent goes on into the next cell, and how far beside its way it drives [m].
_AT_GATE = 1e-6
#: Speeds that are less count as rest [m/s], [rad/s].
_AT_REST = 1e-9


class Braking:
    """Chooses speeds, or turn rates, that are held for a period, such that a body comes to rest before a point.

    The drive changes the speed by at most c = a h in each physics step of the duration h. To change it by s takes
    n = ceil(s / c) steps, in which a body that brakes gets farther than one that stops at once by

        D(s) = h (s - c) + h (s - 2 c) + ... = h ((n - 1) s - c n (n - 1) / 2),

    and a body that accelerates less far than one that has its speed at once. So with a speed v at its beginning and u
    for the rest, a period T takes a body T u + D(v - u) if it brakes, T u - D(u - v) if it accelerates, and then D(u)
    farther if it brakes until it stops. The sum grows with u as long as u can be reached within the period; the
    greatest u for which it is at most the distance to the point is found by halving.
    """

    def __init__(self, acceleration: float, step: float, period: float) -> None:
        """Prepare.

        Args:
            acceleration: The greatest acceleration a, infinite for none [m/s^2]; of turns [rad/s^2].
            step: The duration h of a physics step [s].
            period: For how long a speed is held, T [s]; a multiple of `step`.
        """
        self.is_limited = bool(np.isfinite(acceleration))
        self._step, self._period = step, period
        self._change = acceleration * step
        #: By how much the speed changes within a period at most.
        self._most = acceleration * period

    def distance(self, change: Array) -> Array:
        """Return D for changes of the speed; of the same shape."""
        count = np.maximum(np.ceil(change / self._change), 1.0)
        return self._step * (count - 1.0) * (change - 0.5 * self._change * count)

    def slowed(self, speed: Array) -> Array:
        """Return the speeds after a period of braking; of the same shape."""
        return np.maximum(speed - self._most, 0.0) if self.is_limited else np.zeros_like(speed)

    def approach(self, speed: Array, distance: Array, most: float) -> Array:
        """Return the greatest speeds to hold for the next period such that a body can stop before a point.

        Args:
            speed: The present speeds, not negative; shape (n,).
            distance: The distances to the points, not negative; shape (n,).
            most: The greatest speed.

        Returns:
            The speeds; those of greatest braking where a body cannot stop in time.
        """
        if not self.is_limited:
            return np.minimum(most, distance / self._period)
        low = self.slowed(speed)
        high = np.maximum(np.minimum(speed + self._most, most), low)
        if (self._way(speed, high) <= distance).all():
            return high
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            fits = self._way(speed, middle) <= distance
            low, high = np.where(fits, middle, low), np.where(fits, high, middle)
        # Where `high` itself fits, halving has come to it from below.
        return low

    def _way(self, speed: Array, chosen: Array) -> Array:
        """Return how far a body gets in a period, and then until it stops."""
        change = self.distance(np.abs(chosen - speed))
        return self._period * chosen + np.where(chosen < speed, change, -change) + self.distance(chosen)


class Courses(NamedTuple):
    """The straight lines that agents are to follow, from their positions when the input chosen now takes effect.

    Attributes:
        position: Their positions then [m]; shape (n, d).
        way: The vectors from there to the ends of the present straight lines [m]; shape (n, d).
        distance: The lengths of these [m]; shape (n,).
    """

    position: Array
    way: Array
    distance: Array

    @property
    def direction(self) -> Array:
        """Unit vectors along the way; zero without one; shape (n, d)."""
        return self.way / np.maximum(self.distance, 1e-12)[:, None]


class CellSteering(Steering):
    """Drives to the cell that a strategy chose, without leaving that cell and the present one.

    An agent goes straight to the middle of the side that the two cells share, then straight to the centre of the next
    one. Cells are convex, so both ways lie within them; the speed is such that no turn goes beyond the end of either,
    and that a body whose force is limited can stop there. A vehicle with a heading first stops, and turns on the spot.

    This is certain for a single integrator or a unicycle without noise that perceives its own state exactly, has a turn
    at each step of the world or at every k-th, and is never touched. Any other scenario is refused before the run,
    unless `certified` is false. docs/decisions/0051 has the proof.
    """

    bodies: ClassVar = {"apart_from": "agents or entities"}
    events: ClassVar = {
        "touched": "Another body, `by`, touched the agent, which was certified for the time before.",
    }

    class Parameters(Steering.Parameters):
        """The decisions to follow, the speed, and the required certainty."""

        strategy: str = Field("decide", description="The name of the component that decides.")
        model: str = Field(description="Its knowledge model, by its name under `knowledge_models`.")
        speed: float = Field(1.0, gt=0, description="Greatest speed [m/s].")
        certified: bool = Field(
            True,
            description="Whether to refuse a scenario in which it is not certain that the agent keeps to its two cells"
            " and comes to the next one. If not, the strategy only reports when it has left them.",
        )
        apart_from: tuple[str, ...] = Field(
            (),
            description="Agents, groups and entities that are known never to touch the agent, for example because its"
            " guarantees keep it away, though nothing else excludes that.",
        )

    uncaptured: ClassVar[Collection[str]] = ("_cells", "_drive", "_braking", "_turning")

    def check_scenario(self, view: ScenarioView) -> None:
        """Check that agents certainly stay within their cells."""
        if view.is_initialised and self.parameters.certified:
            CellCheck(view).check()

    def check(self, group: AgentGroup) -> None:
        """Check that the model can follow straight lines, and that there is a strategy."""
        given = self.parameters
        model_named(given.model, group)
        if f"{given.strategy}.plan" not in group.awareness.columns:
            said = f"there is no component `{given.strategy}` that decides where to go: {{use: knowledge.strategy}}"
            raise ParameterError(said, ("strategy",))
        names, model = [each.name for each in group.model.control_input], group.model
        if given.certified and model.noise_deviation(1.0) is not None:
            raise ValueError(
                "an agent whose model has noise does not surely keep to its cells: leave the noise out, or set"
                " `certified: false`"
            )
        if model.heading is None and all(name.startswith("velocity_") for name in names):
            return
        if model.heading is not None and names == ["speed", "turn_rate"] and model.input_bounds()[0][0] <= 0.0:
            return
        raise ValueError("only a single integrator or a unicycle that can stand surely keeps to its cells")

    def initialise_component(self, group: AgentGroup) -> None:
        """Look up the cells, and how the world moves bodies."""
        super().initialise_component(group)
        self._cells = model_named(self.parameters.model, group)
        step = self.environment.time_step
        self._period = seconds(self.period or step)
        self._drive = group.drive or Drive(seconds(step))
        self._braking = Braking(self._drive.acceleration, self._drive.step, self._period)
        self._turning = Braking(self._drive.turn_acceleration, self._drive.step, self._period)
        if self._drive.collides:
            self._surroundings.events.subscribe("contact", self._on_contact, "environment")

    # In each turn

    def _compute(self) -> tuple[Array, Array]:
        model, state = self._group.model, self._group.awareness.state
        present = model.limit(self._group.control_input)
        courses = self._courses(state, present)
        speed = np.minimum(self.parameters.speed, courses.distance / self._period)
        reach = np.minimum(speed[:, None] * self._ahead, courses.distance[:, None])
        ahead = courses.position[:, None] + courses.direction[:, None] * reach[:, :, None]
        if model.heading is None:
            return self._velocities(courses, present), ahead
        return self._turns(courses, state[:, model.heading], present), ahead

    def _update(self, value: tuple[Array, Array]) -> None:
        self._steer(*value)

    def _courses(self, state: Array, present: Array) -> Courses:
        """Return the lines to follow, from the states (n, nx) and present control inputs (n, nu) of agents."""
        position = self._group.model.positions(state)
        if self._drive.lag:
            position = position + self._drive.lag * self._group.model.velocity(state, present)
        target = position.copy()
        for row, (cell, following, _) in enumerate(self._group.awareness[f"{self.parameters.strategy}.plan"]):
            if np.isfinite(cell):
                target[row, :2] = self._target(int(cell), int(following), position[row])
        way = target - position
        return Courses(position, way, lengths(way))

    def _target(self, cell: int, following: int, position: Array) -> Array:
        """Return the end of the straight line to go along; shape (2,)."""
        centre = self._cells.centre(following)
        if cell == following or self._cells.contains(following, position):
            return centre
        gate = self._cells.gate(cell, following)
        apart, beyond = gate - position[:2], centre - position[:2]
        if apart @ apart < _AT_GATE**2:
            return centre
        # A body that cannot stop at once passes the gate without braking for it, if its way goes straight on there.
        aside = abs(apart[0] * beyond[1] - apart[1] * beyond[0])
        goes_on = self._braking.is_limited and apart @ beyond > 0 and aside < _AT_GATE * float(np.sqrt(beyond @ beyond))
        return centre if goes_on else gate

    def _velocities(self, courses: Courses, present: Array) -> Array:
        """Return the velocities of single integrators; shape (n, d)."""
        now = lengths(present)
        speed = self._braking.approach(now, courses.distance, self.parameters.speed)
        velocity: Array = courses.way * (speed / np.maximum(courses.distance, 1e-12))[:, None]
        if not self._braking.is_limited:
            return velocity
        # An agent that moves along another line first comes to rest on it.
        along = present / np.maximum(now, 1e-300)[:, None]
        ahead = (along * courses.way).sum(axis=1)
        aside = lengths(courses.way - ahead[:, None] * along)
        goes_on = (now <= _AT_REST) | ((ahead >= 0.0) & (aside < _AT_GATE))
        return np.where(goes_on[:, None], velocity, along * self._braking.slowed(now)[:, None])

    def _turns(self, courses: Courses, heading: Array, present: Array) -> Array:
        """Return speeds and turn rates of unicycles, which drive or turn on the spot; shape (n, 2)."""
        drive, (speed, turn_rate) = self._drive, present.T
        desired = np.minimum(self.parameters.speed, courses.distance / self._period)
        velocity = courses.way * (desired / np.maximum(courses.distance, 1e-12))[:, None]
        wanted = np.arctan2(velocity[:, 1], velocity[:, 0])
        if drive.lag:
            heading = heading + drive.lag * turn_rate
        error = wrapped(wanted - heading)
        moving = desired > _AT_REST
        off = np.abs(error)
        is_straight = (off < _ALIGNED) & (off * courses.distance < _AT_GATE)
        # While it drives it does not turn, so that its path is straight.
        turns_on = np.abs(turn_rate) > _AT_REST if drive.lag or self._turning.is_limited else np.zeros(len(off), bool)
        drives = moving & is_straight & ~turns_on
        control_input = np.empty((len(off), 2))
        control_input[:, 0] = np.where(
            drives,
            self._braking.approach(np.abs(speed), courses.distance, self.parameters.speed),
            self._braking.slowed(np.abs(speed)),
        )
        rolls_on = (np.abs(speed) > _AT_REST) if self._braking.is_limited else np.zeros(len(off), bool)
        control_input[:, 1] = np.where(
            drives | rolls_on, 0.0, self._turn_rates(error, moving & ~is_straight, turn_rate)
        )
        return control_input

    def _turn_rates(self, error: Array, turning: Mask, present: Array) -> Array:
        """Return the turn rates of vehicles that stand; those that need not turn stop to do so; shape (n,)."""
        if not self._turning.is_limited:
            most = self._drive.turn_rate
            return np.where(turning, np.clip(error / self._period, -most, most), 0.0)
        now = np.abs(present)
        side = np.where(now > _AT_REST, np.sign(present), np.sign(error))
        rate = self._turning.approach(now, np.maximum(error * side, 0.0), self._drive.turn_rate)
        return side * np.where(turning, rate, self._turning.slowed(now))

    def _on_contact(self, event: Event) -> None:
        contact = event.subject
        assert isinstance(contact, Contact)
        if not self.parameters.certified or not contact.begins:
            return
        for one, other in ((contact.first, contact.second), (contact.second, contact.first)):
            if one in self._group.ids:
                said = f"was touched by {other}, which diverts it"
                self.emit_for(self._group.ids.index(one), "touched", said, level=Level.WARNING, by=other)
