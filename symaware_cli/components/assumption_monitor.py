"""Watches whether an environment keeps the assumptions that are made about it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.components.strategy_memory import StrategyMemory, StrategyTurn
from symaware_cli.core import Level
from symaware_cli.synthesis.fragment import LIVENESS
from symaware_cli.synthesis.game import Game
from symaware_cli.world.time import SECOND


class BrokenAssumption(NamedTuple):
    """An assumption that a step of the environment broke, or of which something is overdue.

    Attributes:
        text: The assumption.
        number: Its number; None if it is not written but implied: that an agent moves from cell to cell.
    """

    text: str
    number: int | None


class AssumptionMonitor:
    """Compares the steps of an environment with the assumptions of a game."""

    def __init__(self, game: Game, patience: float | None) -> None:
        """Prepare.

        Args:
            game: The game.
            patience: Time after which something that is to happen again and again is overdue [s]; None for never.
        """
        self._game = game
        self._patience = patience
        self._goals = game.goals(game.assumptions)
        numbered = enumerate(game.assumptions)
        self._numbers = [number for number, each in numbered for one in each.clauses if one.kind in LIVENESS]

    @property
    def goals(self) -> int:
        """The number of things that are assumed to happen again and again."""
        return len(self._goals)

    def broken(
        self, state: int, after: Mapping[str, NDArray[np.intp]], dropped: Collection[int]
    ) -> list[BrokenAssumption]:
        """Return the assumptions that a step broke.

        Args:
            state: The state before the step; -1 at the beginning.
            after: The value of each variable after it; shape (1,) each.
            dropped: The numbers of assumptions that do not count.
        """
        game = self._game
        numbered = [(number, each) for number, each in enumerate(game.assumptions) if number not in dropped]
        if state < 0:
            wrong = [(number, each) for number, each in numbered if not game.holds_at_start([each], after)[0]]
            return [BrokenAssumption(each.text, number) for number, each in wrong]
        now = {name: each[[state]] for name, each in game.values.items()}
        broken = [
            BrokenAssumption(f"{variable.name} moves from cell to cell", None)
            for variable in game.vocabulary.environment
            if after[variable.name][0] not in variable.following[now[variable.name][0]]
        ]
        for number, each in numbered:
            safety = game.safety([each])
            if not all(np.all(holds(now, after) if ahead else holds(after, None)) for holds, ahead in safety):
                broken.append(BrokenAssumption(each.text, number))
        return broken

    def overdue(self, memory: StrategyMemory) -> list[BrokenAssumption]:
        """Return the assumptions of which something is overdue, in their order, without those that were given up."""
        late = {number for number, is_late in zip(self._numbers, memory.overdue, strict=True) if is_late}
        return [
            BrokenAssumption(self._game.assumptions[number].text, number) for number in sorted(late - {*memory.dropped})
        ]

    def reminded(self, memory: StrategyMemory, state: int, turn: StrategyTurn) -> StrategyMemory:
        """Note which goals the environment meets in a state, and report those that are overdue."""
        met = tuple(turn.now if goal[state] else last for goal, last in zip(self._goals, memory.met, strict=True))
        if self._patience is None:
            return memory._replace(met=met)
        late = tuple(turn.now - last > self._patience * SECOND for last in met)
        for number, is_late, was_late in zip(self._numbers, late, memory.overdue, strict=True):
            text = self._game.assumptions[number].text
            if number in memory.dropped or is_late == was_late:
                continue
            if is_late:
                said = f"`{text}` is overdue: nothing for {self._patience:g} s"
                turn.report("assumption-overdue", said, Level.WARNING, assumption=text)
            else:
                turn.report("assumption-kept", f"`{text}` was met", assumption=text)
        return memory._replace(met=met, overdue=late)
