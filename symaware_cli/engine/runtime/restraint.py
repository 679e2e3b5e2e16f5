"""What holds agents back in the steps of the world, such as a fault.

Reasons: docs/decisions/0090-explanations.md
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from symaware_cli.core import AgentGroup
from symaware_cli.geometry import Array


class Restraint(ABC):
    """Changes how some agents of one group move in each step of the world; see `FaultTargets.restrain`.

    It has no state of its own: its effect follows from the scenario, and from the states before and after a step.

    Attributes:
        restrained: Their group and their rows in it, ascending, such as an `AgentSelection`.
    """

    restrained: tuple[AgentGroup, Sequence[int]]

    @abstractmethod
    def request(self, states: Array, inputs: Array, step: float) -> Array:
        """Return the control inputs that the world applies in a step instead of the requested ones.

        Args:
            states: The true states of the agents before the step; shape (m, nx).
            inputs: The requested control inputs, not yet saturated; shape (m, nu).
            step: The duration of the step [s].

        Returns:
            Control inputs, not yet saturated; shape (m, nu).
        """

    @abstractmethod
    def reach(self, before: Array, after: Array) -> Array:
        """Return the states that the agents have after a step instead of those to which the world led them.

        It is asked again until it changes nothing any more, as other restraints may hold back the same agents.

        Args:
            before: The true states before the step; shape (m, nx).
            after: The true states after it; shape (m, nx).
        """
