"""Strategies that are made again during a run, when an agent learns of blocked cells or drops assumptions.

Reasons: docs/decisions/0050-revised-strategies.md
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import Parameters
from symaware_cli.knowledge.synthesis.game import Game
from symaware_cli.knowledge.synthesis.move_graph import BudgetError
from symaware_cli.knowledge.synthesis.strategy import Strategy, synthesise_anywhere
from symaware_cli.knowledge.synthesis.strategy_process import StrategyProcess
from symaware_cli.knowledge.synthesis.vocabulary import Vocabulary

#: The number of strategies kept in memory; older ones are made again when they are needed.
_MOST_KEPT = 16


class Revision(NamedTuple):
    """The knowledge of an agent beyond the formulas and the model; each revision has a strategy of its own.

    Attributes:
        blocked: The cells that cannot be entered, ascending.
        dropped: The numbers of the assumptions that were given up, ascending.
    """

    blocked: tuple[int, ...] = ()
    dropped: tuple[int, ...] = ()


class RevisionParameters(Parameters):
    """The latency and the budget of a new strategy."""

    latency: float = Field(
        0.0,
        ge=0,
        le=1e9,
        description="How long after the agent has learnt something its new strategy takes effect [s].",
    )
    budget: int | None = Field(
        None,
        gt=0,
        description="How many states may be looked at to make it, each as often as it is; without limit if null. The"
        " count is the same on every machine.",
    )
    run_in: Literal["here", "process"] = Field(
        "here",
        description="Where it is made: here, when it is due; or in a process of its own, which begins when the agent"
        " has learnt something, so that the run goes on meanwhile. It is the same strategy.",
    )


@dataclass(frozen=True)
class RevisedStrategy:
    """A strategy for a revision, by the states of the original game.

    Attributes:
        strategy: The strategy; None if it takes more than the budget to make it.
        places: The state of its game for each state of the original one, None if they are the same; shape (size,).
    """

    strategy: Strategy | None
    places: NDArray[np.int32] | None = None

    def covers(self, state: int) -> bool:
        """Whether the strategy has a choice in a state."""
        return self.strategy is not None and self.strategy.covers(self._place(state))

    def choice(self, state: int, goal: int) -> tuple[int, int]:
        """Return the cell to go to, and the goal to pursue then, in a state that the strategy covers."""
        assert self.strategy is not None
        return self.strategy.choice(self._place(state), goal)

    def reaches(self, state: int, goal: int) -> bool:
        """Whether a goal is reached in a state."""
        return self.strategy is not None and bool(self.strategy.reached[goal, self._place(state)])

    def _place(self, state: int) -> int:
        return state if self.places is None else int(self.places[state])


class StrategyRevisions:
    """Makes and keeps the strategies of revisions. They depend only on the game, the revision and the budget.

    Attributes:
        game: The game with all assumptions and all cells.
    """

    def __init__(self, original: Strategy, parameters: RevisionParameters) -> None:
        """Prepare.

        Args:
            original: The strategy that was made before the run.
            parameters: The budget, and where strategies are made.
        """
        self._original = RevisedStrategy(original)
        self.game = original.game
        self._parameters = parameters
        self._made: dict[Revision, RevisedStrategy] = {}
        #: The processes that make strategies now, with their games.
        self._processes: dict[Revision, tuple[Game, StrategyProcess]] = {}

    def begin(self, revision: Revision) -> None:
        """Begin to make the strategy of a revision, if that is done in a process of its own."""
        if self._parameters.run_in == "here" or revision == Revision():
            return
        if revision not in self._made and revision not in self._processes:
            game = self._game(revision)
            self._processes[revision] = game, StrategyProcess(game, self._parameters.budget)

    def strategy(self, revision: Revision) -> RevisedStrategy:
        """Return the strategy of a revision."""
        if revision == Revision():
            return self._original
        if revision not in self._made:
            if len(self._made) >= _MOST_KEPT:
                del self._made[next(iter(self._made))]
            self._made[revision] = self._make(revision)
        return self._made[revision]

    def _make(self, revision: Revision) -> RevisedStrategy:
        try:
            if revision in self._processes:
                game, process = self._processes.pop(revision)
                strategy = process.result()
            else:
                game = self._game(revision)
                strategy = synthesise_anywhere(game, self._parameters.budget)
        except BudgetError:
            return RevisedStrategy(None)
        return RevisedStrategy(strategy, _places(self.game, game) if revision.dropped else None)

    def _game(self, revision: Revision) -> Game:
        """Return the game of a revision."""
        game = self.game
        system = game.vocabulary.cell.system
        assert system is not None
        kept = [each for number, each in enumerate(game.assumptions) if number not in revision.dropped]
        vocabulary = Vocabulary(system.avoiding(revision.blocked), game.vocabulary.environment)
        return Game(vocabulary, kept, game.guarantees)


def _places(game: Game, revised: Game) -> NDArray[np.int32]:
    """Return the state of a game without some assumptions for each state; it lacks their bits of memory."""
    bits = {id(bit.clause): values for bit, values in zip(game.bits, game.bit_values, strict=True)}
    return revised.index(game.values, [bits[id(bit.clause)] for bit in revised.bits])
