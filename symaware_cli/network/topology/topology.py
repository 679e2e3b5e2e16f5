"""Topologies: which agents reach which others with their messages."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from symaware_cli.core import Environment, Links, Parameters, Plugin, Roster, UnsupportedError

Indices = NDArray[np.intp]


class TopologyError(UnsupportedError):
    """A topology cannot be as its parameters want it; `path` is one of these, such as ``("edges", 3)``."""


class TopologyParameters(Parameters):
    """What every topology can be told."""

    members: tuple[str, ...] = Field(
        ("*",),
        min_length=1,
        description="Who takes part, in this order: ids, groups or patterns, such as `leader` and `robot.*`. "
        "All others reach nobody.",
    )


class Topology(Plugin, ABC):
    """Tells which agents reach which others.

    Attributes:
        changes: Whether the links may change from step to step.
        environment: The world.
        roster: Who is who.
        seed: The seed of the run.
        members: Those who take part, as indices in the roster, in their order.
        takes_part: Whether each agent is one of them; shape (n,).
    """

    Parameters: ClassVar[type[BaseModel]] = TopologyParameters

    changes: ClassVar[bool] = False

    environment: Environment
    roster: Roster
    seed: int
    members: Indices
    takes_part: NDArray[np.bool_]

    def initialise(self, environment: Environment, seed: int) -> None:
        """Learn of the world. A subclass that overrides this calls it first.

        Args:
            environment: Who is who is known; where they are, not before `begin`.
            seed: The seed of the run.

        Raises:
            TopologyError: The parameters do not fit who is there.
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
        """The agents that an id, the name of a group or a pattern means, as indices in the roster.

        Args:
            pattern: Whom.
            path: The parameter it stands in.

        Raises:
            TopologyError: There is nobody.
        """
        try:
            return self.roster.matching(pattern)
        except KeyError:
            known = (*self.roster.groups, *self.roster.ids)
            message = f"there is no agent or group `{pattern}`"
            raise TopologyError(message, *path, name=pattern, names=known) from None

    def find_members(self, pattern: str, *path: str | int) -> list[int]:
        """The same, but only those who take part.

        Args:
            pattern: Whom.
            path: The parameter it stands in.

        Raises:
            TopologyError: There is nobody, or none of them takes part.
        """
        found = [index for index in self.find(pattern, *path) if self.takes_part[index]]
        if not found:
            ids = tuple(self.roster.ids[member] for member in self.members)
            raise TopologyError(f"`{pattern}` takes no part, as it is not among the `members`", *path, names=ids)
        return found

    def begin(self, now: int) -> None:
        """Begin to hold, at the start or after another topology did.

        One that remembers links forgets them here: agents have moved meanwhile.

        Args:
            now: In nanoseconds.
        """
        return

    @abstractmethod
    def links(self, now: int) -> Links:
        """The links at a step of the world, in nanoseconds; the same object as before where nothing changed."""
