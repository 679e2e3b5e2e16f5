"""Rewards: sums of terms, each the value or the change of an expression or of the robustness of a specification."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.learning.learning_content import RewardTerm
from symaware_cli.learning.team import Team
from symaware_cli.world import is_finite

Array = NDArray[np.float64]


class Reward:
    """The reward of the agents of a team, in the present episode."""

    def __init__(self, terms: Sequence[Callable[[], _Term]]) -> None:
        """Prepare.

        Args:
            terms: Create the terms at the beginning of an episode.
        """
        self._terms = terms
        self._present: list[_Term] = []

    def begin(self) -> None:
        """Begin an episode: changes are measured from its first instant on."""
        self._present = [each() for each in self._terms]
        for each in self._present:
            each.begin()

    def step(self, count: int) -> Array:
        """Return the reward of a step; shape (n,).

        Args:
            count: The number of agents.
        """
        steps = [each.step() for each in self._present]
        if not steps:
            return np.zeros(count)
        total = steps[0]
        for each in steps[1:]:
            total = total + each
        return total


class _Term:
    """A term with its value at each step."""

    def __init__(self, compute: Callable[[], Array], weight: float) -> None:
        self._compute, self._weight = compute, weight

    def begin(self) -> None:
        """Store the value at the beginning."""

    def step(self) -> Array:
        """Return the reward of a step; an undefined value counts as 0."""
        found = self._weight * self._compute()
        return found if is_finite(found) else np.where(np.isnan(found), 0.0, found)


class _Change(_Term):
    """A term with the change of its value since the previous step."""

    def begin(self) -> None:
        self._before = self._compute()

    def step(self) -> Array:
        now = self._compute()
        change, self._before = now - self._before, now
        return self._weight * np.where(np.isfinite(change), change, 0.0)


class _AtVerdict(_Term):
    """A term with its value at the step of the verdict, and 0 at all others."""

    def __init__(self, compute: Callable[[], Array], weight: float, decided: Callable[[], NDArray[np.bool_]]) -> None:
        super().__init__(compute, weight)
        self._decided = decided

    def begin(self) -> None:
        self._before = self._decided()

    def step(self) -> Array:
        now = self._decided()
        new, self._before = now & ~self._before, now
        return np.where(new, super().step(), 0.0)


def reward_of(team: Team, terms: Sequence[RewardTerm]) -> Reward:
    """Compile the terms of a reward for a team.

    Raises:
        LearningError: An expression is invalid.
    """
    return Reward([_term(team, each) for each in terms])


def _term(team: Team, written: RewardTerm) -> Callable[[], _Term]:
    weight, name = written.weight, written.specification
    if name is None:
        columns = team.columns(written.of, written.value or "0")

        def compute() -> Array:
            return columns()[:, 0]

        kind = _Change if written.as_ == "change" else _Term
        return lambda: kind(compute, weight)
    limit = written.limit

    def robustness() -> Array:
        return np.clip(team.robustness(name), -limit, limit)

    if written.as_ == "verdict":
        return lambda: _AtVerdict(robustness, weight, lambda: team.decided(name))
    kind = _Change if written.as_ == "change" else _Term
    return lambda: kind(robustness, weight)
