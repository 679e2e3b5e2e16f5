"""Simulators that move the agents of a model with more internal state than the states of the agents."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from symaware_cli.world.chance import Array


class StepSimulator(ABC):
    """Moves the agents of a group, one time step of the world at a time.

    A model of equations needs none: this is for models that are programs of their own, such as FMUs. It takes part in
    the capture of a simulation (`symaware_cli.core.stateful.Stateful`).
    """

    @abstractmethod
    def start(self, states: Array) -> None:
        """Begin with some states.

        Args:
            states: Shape (n, nx).

        Raises:
            ValueError: It cannot begin with them; the message is for the author of the scenario.
        """

    @abstractmethod
    def step(self, time: int, states: Array, inputs: Array, rows: Sequence[int]) -> Array:
        """Return the states after one time step.

        Args:
            time: When the step begins [ns].
            states: The present states; shape (n, nx).
            inputs: The control inputs, held over the step; shape (n, nu).
            rows: The agents that are present; the others stay as they are.

        Returns:
            The states after the step; shape (n, nx).
        """
