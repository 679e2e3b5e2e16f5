"""Topologies that break a rule are named, with the method and a correction."""

import random
from itertools import count
from typing import Any, ClassVar

import numpy as np
import pytest
from deviating import deviations

from symaware_cli import Environment, Links, Topology
from symaware_cli.testing import check_topology


class Pairs(Topology):
    """A valid topology that links the first member to all others."""

    def initialise(self, environment: Environment, seed: int) -> None:
        super().initialise(environment, seed)
        self._kept = self.made()

    def links(self, now: int) -> Any:
        return self._kept

    def made(self) -> Any:
        return Links.of(len(self.roster), np.full(len(self.members) - 1, self.members[0]), self.members[1:])


class Renewing(Pairs):
    """Returns a new object each time."""

    def links(self, now: int) -> Any:
        return self.made()


class Growing(Pairs):
    """Changes its links without declaring `changes`."""

    def links(self, now: int) -> Any:
        return self._kept if now < 100_000_000 else self._none()

    def _none(self) -> Any:
        if not hasattr(self, "_empty"):
            self._empty = Links.of(len(self.roster), np.empty(0, np.intp), np.empty(0, np.intp))
        return self._empty


class Listing(Pairs):
    """Returns a list."""

    def links(self, now: int) -> Any:
        return [(0, 1)]


class Unsorted(Pairs):
    """Returns links that are not sorted."""

    def made(self) -> Any:
        return Links(len(self.roster), np.array([1, 0]), np.array([0, 1]))


class Selfish(Pairs):
    """Links an agent to itself."""

    def made(self) -> Any:
        return Links(len(self.roster), np.array([0, 2]), np.array([1, 2]))


class Few(Pairs):
    """Returns links of two agents only."""

    def made(self) -> Any:
        return Links(2, np.array([0]), np.array([1]))


class Everyone(Pairs):
    """Links agents that are not members."""

    def made(self) -> Any:
        return Links.of(len(self.roster), np.array([0]), np.array([4]))


class Rolling(Pairs):
    """Draws from the global generator."""

    changes: ClassVar = True

    def links(self, now: int) -> Any:
        random.random()
        return self._kept


NUMBERS = count()


class Alternating(Pairs):
    """Returns other links at each call."""

    changes: ClassVar = True

    def links(self, now: int) -> Any:
        return Links.of(len(self.roster), np.array([0]), np.array([1 + next(NUMBERS) % 3]))


class Failing(Pairs):
    """Branches on an array."""

    changes: ClassVar = True

    def links(self, now: int) -> Any:
        if now and self.environment.snapshot().positions[:, 0] > 0.0:
            return None
        return self._kept


BROKEN: dict[type[Topology], tuple[str, ...]] = {
    Renewing: ("Renewing.links (", "a new object for equal links", "the same object until they change"),
    Growing: ("Growing.changes (", "is False, and its links change", "declare `changes = True`"),
    Listing: ("Listing.links (", "returns a list", "return `Links`"),
    Unsorted: ("Unsorted.links (", "not sorted", "`Links.of`"),
    Selfish: ("Selfish.links (", "a link of robot.2 to itself"),
    Few: ("Few.links (", "links of 2 agents", "the number of agents: 5"),
    Rolling: ("Rolling.links (", "the global generator of Python"),
    Alternating: ("Alternating.links (", "other links when it is called again at once"),
    Failing: ("Failing.links (test_topology_check.py, line", "branches on an array", "np.where"),
}


@pytest.mark.parametrize("kind", BROKEN, ids=lambda kind: kind.__name__)
def test_a_broken_topology_is_named_with_the_method_and_a_correction(kind: type[Topology]) -> None:
    said = deviations(check_topology, kind)
    for words in BROKEN[kind]:
        assert words in said


def test_links_end_at_members_only() -> None:
    said = deviations(check_topology, Everyone, members=["robot.0", "robot.1"])
    assert "Everyone.links (" in said
    assert "links of agents that are not `members`" in said


def test_a_topology_that_keeps_its_links_conforms() -> None:
    check_topology(Pairs)
    check_topology(Pairs, {"agents.robot.count": 3}, members=["robot.1", "robot.2"])
