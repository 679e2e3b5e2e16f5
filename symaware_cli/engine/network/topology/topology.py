"""Base class of topologies, which determine the links between agents."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from symaware_cli.core import Environment, Links, Parameters, Plugin, Roster, UnsupportedError
from symaware_cli.geometry import Indices


class TopologyError(UnsupportedError):
    """The parameters of a topology do not fit; `path` is that of a parameter, such as ``("edges", 3)``."""


class TopologyParameters(Parameters):
    """Parameters of every topology."""

    members: tuple[str, ...] = Field(
        ("*",),
        min_length=1,
        description="Who takes part, in this order: ids, groups or patterns, such as `leader` and `robot.*`. "
        "All others reach nobody.",
    )


class Topology(Plugin, ABC):
    """Determines which agents reach which others by messages.

    Attributes:
        changes: Whether the links may change from step to step.
        environment: The world.
        roster: All agents.
        seed: The seed of the run.
        members: The agents that take part, as indices in the roster, in their order.
        takes_part: Whether each agent takes part; shape (n,).
    """

    Parameters: ClassVar[type[BaseModel]] = TopologyParameters

    changes: ClassVar[bool] = False

    environment: Environment
    roster: Roster
    seed: int
    members: Indices
    takes_part: NDArray[np.bool_]

    def initialise(self, environment: Environment, seed: int) -> None:
        """Look up the members in the world. A subclass that overrides this calls it first.

        Args:
            environment: The world; its roster is known, but positions only from `begin` on.
            seed: The seed of the run.

        Raises:
            TopologyError: The parameters do not fit the agents.
        """
        self.environment = environment
        self.roster = environment.roster
        self.seed = seed
        patterns = self.parameters.members
        found = [
            (index, number) for number, each in enumerate(patterns) for index in self.find(each, "members", number)
        ]
        self.members = np.array(list(dict.fromkeys(index for index, _ in found)), np.intp)
        self.takes_part = np.zeros(len(self.roster), bool)
        self.takes_part[self.members] = True

    def find(self, pattern: str, *path: str | int) -> list[int]:
        """Return the agents that an id, the name of a group or a pattern matches, as indices in the roster.

        Args:
            pattern: The id, name or pattern.
            path: The path of the parameter that contains it.

        Raises:
            TopologyError: It matches no agent.
        """
        try:
            return self.roster.matching(pattern)
        except KeyError:
            known = (*self.roster.groups, *self.roster.ids)
            message = f"there is no agent or group `{pattern}`"
            raise TopologyError(message, *path, name=pattern, names=known) from None

    def find_members(self, pattern: str, *path: str | int) -> list[int]:
        """Return the members that an id, the name of a group or a pattern matches; see `find`.

        Args:
            pattern: The id, name or pattern.
            path: The path of the parameter that contains it.

        Raises:
            TopologyError: It matches no agent, or no member.
        """
        found = [index for index in self.find(pattern, *path) if self.takes_part[index]]
        if not found:
            ids = tuple(self.roster.ids[member] for member in self.members)
            raise TopologyError(f"`{pattern}` is not among the `members`", *path, names=ids)
        return found

    def begin(self, now: int) -> None:
        """Start to hold, at the beginning of the run or after another topology.

        A topology that remembers links forgets them here, since agents have moved.

        Args:
            now: The present time, in nanoseconds.
        """
        return

    @abstractmethod
    def links(self, now: int) -> Links:
        """Return the links at a step of the world [ns]; the same object as before if nothing has changed."""
