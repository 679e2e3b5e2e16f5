"""Environments that break a rule are named, with the method and a correction."""

import time
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import pytest
from deviating import deviations
from numpy.typing import NDArray

from symaware_cli import Environment, Obstacle
from symaware_cli.core import EntityGroup
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.testing import check_environment

Array = NDArray[np.float64]


class Drawing(KinematicEnvironment):
    """Draws from the global generator."""

    def step(self) -> None:
        super().step()
        self._states = [state + 0.001 * np.random.rand(*state.shape) for state in self._states]  # noqa: NPY002


class Timed(KinematicEnvironment):
    """Reads the clock."""

    def step(self) -> None:
        time.monotonic()
        super().step()


class Careless(KinematicEnvironment):
    """Changes arrays that it has returned."""

    def state(self, group: EntityGroup) -> Array:
        state = super().state(group)
        state.flags.writeable = True
        state += 0.1
        return state


class Open(KinematicEnvironment):
    """Returns arrays that callers can change."""

    def state(self, group: EntityGroup) -> Array:
        return super().state(group).copy()


class Unlimited(KinematicEnvironment):
    """Applies control inputs beyond the limits of the model."""

    def applied_input(self, group: EntityGroup) -> Array:
        applied: Array = super().applied_input(group) + 100.0
        applied.flags.writeable = False
        return applied


class Short(KinematicEnvironment):
    """Returns the inputs of one agent."""

    def applied_input(self, group: EntityGroup) -> Array:
        return super().applied_input(group)[:1]


class Elsewhere(KinematicEnvironment):
    """Begins in other states than the initial ones."""

    def initialise(self, groups: Sequence[EntityGroup], obstacles: Mapping[str, Obstacle], seed: int) -> None:
        super().initialise(groups, obstacles, seed)
        self._states = [state + 1.0 for state in self._states]
        for state in self._states:
            state.flags.writeable = False


class Endless(KinematicEnvironment):
    """Moves agents to infinity."""

    def step(self) -> None:
        super().step()
        self._states = [state * np.inf for state in self._states]


class Requesting(KinematicEnvironment):
    """Changes the control inputs that the groups request."""

    def step(self) -> None:
        super().step()
        for group in self.groups:
            group.control_input = group.control_input + 0.1


class Standing(KinematicEnvironment):
    """Does not advance its time."""

    def step(self) -> None:
        super().step()
        self._time = 0


class Failing(KinematicEnvironment):
    """Raises an exception."""

    def step(self) -> None:
        raise ArithmeticError("the ground gave way")


STEPS: list[int] = []


class Remembering(KinematicEnvironment):
    """Depends on earlier runs."""

    def step(self) -> None:
        super().step()
        STEPS.append(1)
        self._states = [state + 1e-6 * len(STEPS) for state in self._states]
        for state in self._states:
            state.flags.writeable = False


class Coupled(KinematicEnvironment):
    """Lets agents of different runs interact, and declares `batchable`."""

    batchable: ClassVar = True

    def step(self) -> None:
        super().step()
        self._states = [state + 1e-3 * state.mean() for state in self._states]
        for state in self._states:
            state.flags.writeable = False


class Partial(Environment):
    """Implements nothing."""


BROKEN: dict[type[Environment], tuple[str, ...]] = {
    Drawing: ("Drawing.step (test_environment_check.py, line", "the global generator of NumPy", "generator(seed, path"),
    Timed: ("Timed.step (test_environment_check.py, line", "reads the wall clock (`time.monotonic`)"),
    Careless: ("Careless.state (", "array"),
    Open: ("Open.state (", "returns an array that callers can change", "array.flags.writeable = False"),
    Unlimited: ("Unlimited.applied_input (", "beyond the limits of the model"),
    Short: ("Short.applied_input (", "returns the shape (1, 2)", "an array of the shape (3, 2)"),
    Elsewhere: ("Elsewhere.initialise (", "elsewhere than in their `initial_state`"),
    Endless: ("Endless.step (", "not finite"),
    Requesting: ("Requesting.step (", "changes the control inputs that the groups request"),
    Standing: ("Standing.snapshot", "is of 0 s at 0.05 s of simulated time"),
    Failing: ("Failing.step (", "raises ArithmeticError: the ground gave way"),
    Remembering: ("Remembering.step (", "is not repeatable", "the true state of robot differs after step 1"),
    Coupled: ("Coupled.batchable", "is declared, but the run with seed"),
}


@pytest.mark.parametrize("kind", BROKEN, ids=lambda kind: kind.__name__)
def test_a_broken_environment_is_named_with_the_method_and_a_correction(kind: type[Environment]) -> None:
    said = deviations(check_environment, kind)
    for words in BROKEN[kind]:
        assert words in said


def test_an_incomplete_environment_is_reported_with_its_missing_methods() -> None:
    assert "Partial (" in (said := deviations(check_environment, Partial))
    assert "does not implement applied_input, snapshot, state, step" in said


class Windy(KinematicEnvironment):
    """A valid environment that moves agents with the wind."""

    def step(self) -> None:
        super().step()
        states: list[Any] = [state + 0.001 for state in self._states]
        for state in states:
            state.flags.writeable = False
        self._states = states


def test_an_environment_that_makes_new_arrays_conforms() -> None:
    check_environment(Windy, {"agents.robot.count": 2}, time_step=0.1)
