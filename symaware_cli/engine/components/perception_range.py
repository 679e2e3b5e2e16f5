"""Perception of other agents within range, with a field of view, occlusion, delay, noise and dropouts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup, GroupComponent, Observation, Parameters, Snapshot, Tracks, Turn
from symaware_cli.geometry import Array, Indices, Mask

NotNegative = Annotated[float, Field(ge=0)]


class Sight(NamedTuple):
    """The pairs of agents in which one sees the other.

    Attributes:
        snapshot: The world at that time.
        rows: The seeing agent of each pair, as a row of the group, ascending; shape (m,).
        others: The seen agent of each pair, as an index in the roster; shape (m,).
    """

    snapshot: Snapshot
    rows: Indices
    others: Indices


class RangePerception(GroupComponent):
    """Perceives other agents that are near, in view and not hidden, and the own state, all with errors.

    Another agent is seen if its position is within range, within the field of view (a wedge around the heading, of any
    height in space) and, with `occlusion`, if no obstacle cuts the straight line between the centres of both; in
    `pybullet` the exact shapes of the obstacles count. Bodies of agents hide nothing.

    All errors are normal, without bias and independent of each other. The error in the perception of another agent
    depends only on the two agents and the turn, not on which other agents are seen.

    With a delay, both the others and the own state are perceived as they were. Until the delay has passed, nothing is
    measured, and agents keep their initial beliefs.

    It updates the state, the observation (for estimators such as `uncertainty.gaussian`) and the tracks: the others
    seen at this instant, as measured. An agent that is out of sight is forgotten at once, unless an estimator with a
    memory follows.
    """

    batchable = True

    sees_world = True

    class Parameters(Parameters):
        """Parameters of the perception."""

        range: float = Field(gt=0, description="Greatest distance between positions at which another is seen [m].")
        field_of_view: float | None = Field(
            None,
            gt=0,
            le=2 * math.pi,
            description="Width of the field of view, half to either side of the heading [rad]; all around if null.",
        )
        position_noise: NotNegative = Field(
            0.0, description="Standard deviation of the measured positions of others, along each axis [m]."
        )
        velocity_noise: NotNegative = Field(
            0.0, description="Standard deviation of the measured velocities of others, along each axis [m/s]."
        )
        self_noise: NotNegative | tuple[NotNegative, ...] = Field(
            0.0,
            description="Standard deviation of the measured own state, in its units: one number for all elements, "
            "or a list with one for each.",
        )
        delay: NotNegative = Field(
            0.0,
            description="How old what is seen is [s]; rounded to a whole number of the environment's time steps.",
        )
        dropout: float = Field(
            0.0, ge=0, le=1, description="Probability that another who could be seen is missed, at each turn."
        )
        occlusion: bool = Field(False, description="Whether obstacles of the environment hide what is behind them.")

    def check(self, group: AgentGroup) -> None:
        """Check that the model has a heading for the field of view, and a deviation for each element of the state."""
        model, parameters = group.model, self.parameters
        if self._has_narrow_view() and model.heading is None:
            raise ValueError("`field_of_view` needs a model with a heading, and this one has none")
        deviations = np.shape(parameters.self_noise)
        if deviations not in ((), (len(model.state),)):
            names = ", ".join(quantity.name for quantity in model.state)
            raise ValueError(
                f"`self_noise` is a list of {deviations[0]}, and the state has {len(model.state)} elements: {names}"
            )

    def perceives(self) -> Mapping[str, bool]:
        """The own state and those of others, exactly without errors, delay and dropouts."""
        given = self.parameters
        noisy = given.position_noise or given.velocity_noise or given.dropout
        return {"own": not (np.any(given.self_noise) or given.delay), "others": not (noisy or given.delay)}

    def initialise_component(self, group: AgentGroup) -> None:
        """Look up the group in the world's roster."""
        super().initialise_component(group)
        parameters, environment = self.parameters, self.environment
        self._number = environment.roster.number(group.name)
        self._start = environment.roster.start(group.name)
        self._state_deviation = np.broadcast_to(np.asarray(parameters.self_noise, float), len(group.model.state))
        self._delay = round(parameters.delay * 1e9 / environment.time_step) * environment.time_step
        #: What was seen but is not old enough yet, and before it the latest that is.
        self._past: tuple[Sight, ...] = ()

    @property
    def turn(self) -> Turn:
        """The turn that keys the errors: delayed perception has the same errors as perception without delay."""
        turn = super().turn
        return turn._replace(instant=turn.instant - self._delay)

    def _compute(self) -> tuple[Observation, tuple[Sight, ...]]:
        parameters, count = self.parameters, len(self._group)
        sight, past = self._delayed(self._visible())
        if sight is None:
            time, state = self.now - self._delay, None
            no_others, no_vectors = (
                np.empty(0, np.intp),
                np.empty((2, 0, self.environment.snapshot().positions.shape[1])),
            )
            tracks = self._tracks(time, np.zeros(count, np.intp), no_others, *no_vectors)
        else:
            snapshot, rows, others = sight
            time, state = snapshot.time, self._own_state(snapshot)
            positions, velocities = snapshot.positions.take(others, 0), snapshot.velocities.take(others, 0)
            self._add_noise(rows, others, positions, velocities)
            if parameters.dropout:
                drawn = self.random.uniform_of(rows, self.environment.roster.numbers[others], 1, "dropout")[:, 0]
                noticed = drawn >= parameters.dropout
                rows, others = rows[noticed], others[noticed]
                positions, velocities = positions[noticed], velocities[noticed]
            counts = np.bincount(rows, minlength=count)
            tracks = self._tracks(time, counts, others, positions, velocities)
        observation = Observation(
            time, state, self._state_deviation, tracks, parameters.position_noise, parameters.velocity_noise
        )
        return observation, past

    def _update(self, value: tuple[Observation, tuple[Sight, ...]]) -> None:
        observation, self._past = value
        awareness = self._group.awareness
        if observation.state is not None:
            awareness.state = observation.state
        awareness.observation = observation
        awareness.seen = observation.tracks

    def _has_narrow_view(self) -> bool:
        width = self.parameters.field_of_view
        return width is not None and width < 2 * math.pi

    def _delayed(self, present: Sight) -> tuple[Sight | None, tuple[Sight, ...]]:
        """Return the sight of one delay ago, None at first, and those to keep for later turns."""
        if not self._delay:
            return present, ()
        past, then = (*self._past, present), self.now - self._delay
        old = sum(sight.snapshot.time <= then for sight in past)
        past = past[max(old - 1, 0) :]
        return (past[0] if old else None), past

    def _own_state(self, snapshot: Snapshot) -> Array:
        """Return the own states with errors; shape (n, nx)."""
        state = snapshot.states[self._number].copy()
        if self._state_deviation.any():
            state += self._state_deviation * self.random.standard_normal(state.shape[1], "own state")
        state.flags.writeable = False
        return state

    def _visible(self) -> Sight:
        """Return the pairs that are within range, in view and not hidden."""
        environment, parameters = self.environment, self.parameters
        snapshot = environment.snapshot()
        positions = snapshot.positions
        one, other, _ = environment.proximity.directed(positions, parameters.range)
        if len(self._group) < len(positions):
            first, last = np.searchsorted(one, (self._start, self._start + len(self._group)))
            one, other = one[first:last], other[first:last]
        if self._has_narrow_view():
            seen = self._in_view(snapshot, one, other)
            one, other = one[seen], other[seen]
        if parameters.occlusion:
            seen = environment.in_sight(one, other)
            one, other = one[seen], other[seen]
        return Sight(snapshot, one - self._start if self._start else one, other)

    def _in_view(self, snapshot: Snapshot, one: Indices, other: Indices) -> Mask:
        """Return whether others are within half a field of view of the heading; shape (m,).

        The cosine decreases on [0, pi], so angles are compared without computing them.
        """
        heading = np.ascontiguousarray(snapshot.states[self._number][:, self._group.model.heading])
        row = one - self._start
        away = snapshot.positions.take(other, 0) - snapshot.positions.take(one, 0)
        ahead = away[:, 0] * np.cos(heading).take(row) + away[:, 1] * np.sin(heading).take(row)
        distance = np.sqrt(away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1])
        return ahead >= distance * math.cos(0.5 * self.parameters.field_of_view)

    def _add_noise(self, rows: Indices, others: Indices, positions: Array, velocities: Array) -> None:
        """Add measurement errors to positions and velocities of others, in place."""
        parameters, dimensions = self.parameters, positions.shape[1]
        if not parameters.position_noise and not parameters.velocity_noise:
            return
        numbers = self.environment.roster.numbers[others]
        # Errors of velocities come after those of positions, which are therefore the same with or without them.
        width = 2 * dimensions if parameters.velocity_noise else dimensions
        errors = self.random.standard_normal_of(rows, numbers, width, "others")
        positions += parameters.position_noise * errors[:, :dimensions]
        if parameters.velocity_noise:
            velocities += parameters.velocity_noise * errors[:, dimensions:]

    def _tracks(self, time: int, counts: Indices, others: Indices, positions: Array, velocities: Array) -> Tracks:
        """Return tracks of the bodies that were seen at a time."""
        pointers = np.zeros(len(counts) + 1, np.intp)
        np.cumsum(counts, out=pointers[1:])
        for array in (positions, velocities):
            array.flags.writeable = False  # spares the tracks a copy
        return Tracks(time, pointers, others, positions, velocities)
