"""Actuators: how physics worlds make bodies do what models say."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import EntityGroup, WorldError, nanoseconds
from symaware_cli.environments.process_noise import ProcessNoise
from symaware_cli.world.integration import integrate

Array = NDArray[np.float64]


class Actuator:
    """Says which velocities the bodies of a group are to have in each physics step of a time step.

    It moves the model as the kinematic world does, from where the time step begins, and takes the mean velocity over
    each physics step. A body that has these velocities is, step by step, where the model would be. The velocities are
    laid out at the beginning of the time step: who is knocked off its way meanwhile goes on in parallel to it.

    A model whose state has the velocity itself says an acceleration. Then the actuator adds to the velocity that the
    body has, and what a collision did to it stays.

    Attributes:
        group: Whom it moves.
        adds: Whether the velocities are to be added to those of the bodies, because the state has the velocity.
        turns: Whether it turns bodies; those of models without a heading never turn.
    """

    def __init__(self, group: EntityGroup, time_step: int, substeps: int, seed: int) -> None:
        """Look at a model.

        Args:
            group: Whom to move.
            time_step: The environment's time step, in nanoseconds.
            substeps: How many physics steps that has.
            seed: The seed of the run.

        Raises:
            WorldError: No body does what the model says.
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
            )
        if model.velocities and len(model.velocities) != len(model.position):
            raise WorldError("the model's state has the velocity along some axes only", *path)
        check_time_step(group, time_step)
        self.group = group
        self.adds = bool(model.velocities)
        self.turns = model.heading is not None
        columns = [*(model.velocities or model.position), *(() if model.heading is None else (model.heading,))]
        self._columns = _side_by_side(columns)
        self._positions, self._velocities = _side_by_side(model.position), _side_by_side(model.velocities)
        # Without a heading the way is straight enough to be taken in one.
        self._parts = substeps if model.time_step is None and (self.turns or self.adds) else 1
        self._part = time_step / 1e9 / self._parts
        added = np.arange(len(columns)) < len(model.velocities)
        #: What makes the change of each element over a part of the time step what is planned for a physics step.
        self._share = np.where(added, self._parts / substeps, 1.0 / self._part)
        covariance = model.noise_covariance(time_step / 1e9)
        self._noise = None if covariance is None else ProcessNoise(group, covariance, seed)
        self._noise_share = np.where(added, 1.0 / substeps, 1e9 / time_step)
        if covariance is not None and self.adds and covariance[list(model.position)].any():
            raise WorldError(
                "`process_noise` of a position would tear it from its velocity, which the state has too; give each "
                "element its own, and 0 to positions",
                *path,
            )

    def plan(self, state: Array, control_input: Array, time: int) -> Array:
        """Lay out the velocities of a time step.

        Args:
            state: Where the bodies are; shape (n, nx).
            control_input: The saturated control inputs; shape (n, nu).
            time: When it begins, in nanoseconds.

        Returns:
            For each physics step the velocity of the position [m/s] and, of bodies that turn, the turn rate [rad/s];
            shape (substeps, n, d) or (substeps, n, d + 1). Where it is the same in all of them, it stands there once.
        """
        columns, at = self._columns, state
        planned = np.empty((self._parts, len(state), len(self._share)))
        for number in range(self._parts):
            after = integrate(self.group.model, at, control_input, self._part)
            planned[number] = (after[:, columns] - at[:, columns]) * self._share
            at = after
        if self._noise:
            planned += self._noise.draw(time)[:, columns] * self._noise_share
        return planned

    def state(self, positions: Array, headings: Array, motion: Array) -> Array:
        """Return the states of agents whose bodies are so, read-only; shape (n, nx).

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
    """See whether a model can take the environment's time step, in nanoseconds.

    Raises:
        WorldError: It is a map over another one.
    """
    own = group.model.time_step
    if own is not None and nanoseconds(own) != time_step:
        raise WorldError(
            f"the model is a map over {own:g} s, and the environment steps by {time_step / 1e9:g} s: both need the "
            "same `time_step`",
            *("agents", group.name, "model"),
        )


def _side_by_side(columns: Sequence[int]) -> slice | list[int]:
    """Columns as a slice where they are one, which NumPy takes four times faster."""
    if columns and list(columns) == list(range(columns[0], columns[0] + len(columns))):
        return slice(columns[0], columns[0] + len(columns))
    return list(columns)
