"""Actuators: the velocities that physics worlds give to bodies so that they move as their models do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from symaware_cli.core import EntityGroup, WorldError, nanoseconds
from symaware_cli.engine.environments.process_noise import ProcessNoise
from symaware_cli.geometry import Array
from symaware_cli.world import integrate


class Actuator:
    """Computes the velocities that the bodies of a group shall have in each physics step of a time step.

    It integrates the model over the time step as the kinematic world does, and takes the mean velocity over each
    physics step. A body with these velocities is, after each physics step, where the model would be. The velocities
    are planned at the beginning of the time step: a body that is pushed aside meanwhile continues in parallel to the
    planned path.

    If the state of a model includes the velocity, the model yields an acceleration. The actuator then adds to the
    present velocity of the body, so the effects of a collision remain.

    Attributes:
        group: The group that it moves.
        adds: Whether the velocities are added to those of the bodies, because the state includes the velocity.
        turns: Whether it turns bodies; those of models without a heading never turn.
    """

    def __init__(self, group: EntityGroup, time_step: int, substeps: int, seed: int) -> None:
        """Check a model, and prepare for planning.

        Args:
            group: The group to move.
            time_step: The environment's time step, in nanoseconds.
            substeps: The number of physics steps in a time step.
            seed: The seed of the run.

        Raises:
            WorldError: No body can move as the model does.
        """
        model = group.model
        path = ("agents", group.name, "model")
        has = {*model.position, *model.velocities, *(() if model.heading is None else (model.heading,))}
        more = [quantity.name for index, quantity in enumerate(model.state) if index not in has]
        if more:
            raise WorldError(
                "bodies have a position, a heading and a velocity, and the model's state has "
                f"`{'`, `'.join(more)}` too",
                *path,
                needs="vehicles" if model.vehicle() is not None else None,
            )
        if model.velocities and len(model.velocities) != len(model.position):
            raise WorldError("the model's state has the velocity along some axes only", *path)
        check_time_step(group, time_step)
        self.group = group
        self.adds = bool(model.velocities)
        self.turns = model.heading is not None
        columns = [*(model.velocities or model.position), *(() if model.heading is None else (model.heading,))]
        self._columns = _as_slice(columns)
        self._positions, self._velocities = _as_slice(model.position), _as_slice(model.velocities)
        # Without a heading the path within a time step is straight enough to be integrated in one part.
        self._parts = substeps if model.time_step is None and (self.turns or self.adds) else 1
        self._part = time_step / 1e9 / self._parts
        added = np.arange(len(columns)) < len(model.velocities)
        #: Factor from the change of each element over a part of the time step to its value for a physics step.
        self._factor = np.where(added, self._parts / substeps, 1.0 / self._part)
        covariance = model.noise_covariance(time_step / 1e9)
        self._noise = None if covariance is None else ProcessNoise(group, covariance, seed)
        self._noise_factor = np.where(added, 1.0 / substeps, 1e9 / time_step)
        if covariance is not None and self.adds and covariance[list(model.position)].any():
            raise WorldError(
                "`process_noise` of a position would be inconsistent with the velocity, which the state has too; give "
                "each element its own, and 0 to positions",
                *path,
            )

    def plan(self, state: Array, control_input: Array, time: int) -> Array:
        """Plan the velocities of a time step.

        Args:
            state: The states at the beginning; shape (n, nx).
            control_input: The saturated control inputs; shape (n, nu).
            time: The beginning of the time step, in nanoseconds.

        Returns:
            For each physics step the velocity of the position [m/s] and, for bodies that turn, the turn rate [rad/s];
            shape (substeps, n, d) or (substeps, n, d + 1). The first axis has length 1 if all physics steps are equal.
        """
        columns, at = self._columns, state
        planned = np.empty((self._parts, len(state), len(self._factor)))
        for number in range(self._parts):
            after = integrate(self.group.model, at, control_input, self._part)
            planned[number] = (after[:, columns] - at[:, columns]) * self._factor
            at = after
        if self._noise:
            planned += self._noise.draw(time)[:, columns] * self._noise_factor
        return planned

    def state(self, positions: Array, headings: Array, motion: Array) -> Array:
        """Return the states of agents from the poses and velocities of their bodies, read-only; shape (n, nx).

        Args:
            positions: [m]; shape (n, d) or more.
            headings: Counting turns [rad]; shape (n,).
            motion: Velocities [m/s]; shape (n, d) or more.
        """
        model, dimensions = self.group.model, len(self.group.model.position)
        state = np.empty((len(positions), len(model.state)))
        state[:, self._positions] = positions[:, :dimensions]
        if self.adds:
            state[:, self._velocities] = motion[:, :dimensions]
        if model.heading is not None:
            state[:, model.heading] = headings
        state.flags.writeable = False
        return state


def check_time_step(group: EntityGroup, time_step: int) -> None:
    """Check that a model in discrete time has the environment's time step, in nanoseconds.

    Raises:
        WorldError: It has another one.
    """
    own = group.model.time_step
    if own is not None and nanoseconds(own) != time_step:
        raise WorldError(
            f"the model is a map over {own:g} s, and the environment steps by {time_step / 1e9:g} s: both need the "
            "same `time_step`",
            *("agents", group.name, "model"),
        )


def _as_slice(columns: Sequence[int]) -> slice | list[int]:
    """Return adjacent columns as a slice, which NumPy indexes four times faster than a list."""
    if columns and list(columns) == list(range(columns[0], columns[0] + len(columns))):
        return slice(columns[0], columns[0] + len(columns))
    return list(columns)
