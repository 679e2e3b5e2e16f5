"""Makes a strategy in a process of its own, while the run goes on."""

from __future__ import annotations

import pickle
import weakref
from contextlib import suppress
from typing import BinaryIO, NamedTuple

from symaware_cli.knowledge.abstraction.transition_system import TransitionSystem
from symaware_cli.knowledge.synthesis.fragment import clauses
from symaware_cli.knowledge.synthesis.game import Game, Statement
from symaware_cli.knowledge.synthesis.move_graph import BudgetError
from symaware_cli.knowledge.synthesis.strategy import Strategy, synthesise_anywhere
from symaware_cli.knowledge.synthesis.strategy_codec import decoded, encoded
from symaware_cli.knowledge.synthesis.vocabulary import Variable, Vocabulary
from symaware_cli.world import PythonChild, how_it_ended, read, write


class GameText(NamedTuple):
    """A game as it is written, which can be sent to another process.

    Attributes:
        system: Where the agent may be, and how it may move.
        environment: The variables of the environment.
        assumptions: The assumptions as texts.
        guarantees: The guarantees as texts.
    """

    system: TransitionSystem
    environment: tuple[Variable, ...]
    assumptions: tuple[str, ...]
    guarantees: tuple[str, ...]

    @classmethod
    def of(cls, game: Game) -> GameText:
        """Return the text of a game."""
        system = game.vocabulary.cell.system
        assert system is not None
        texts = (tuple(each.text for each in statements) for statements in (game.assumptions, game.guarantees))
        return cls(system, tuple(game.vocabulary.environment), *texts)

    def game(self) -> Game:
        """Return the game."""
        vocabulary = Vocabulary(self.system, self.environment)
        assumptions, guarantees = (
            [Statement(text, clauses(text, vocabulary)) for text in texts]
            for texts in (self.assumptions, self.guarantees)
        )
        return Game(vocabulary, assumptions, guarantees)


class StrategyProcess:
    """A strategy that another process makes; it is the same as one that is made here."""

    def __init__(self, game: Game, budget: int | None) -> None:
        """Start the process.

        Args:
            game: The game.
            budget: The greatest effort, as in `synthesise_anywhere`.
        """
        self._game = game
        self._child = PythonChild(f"{__name__}:serve")
        #: Ends the process if nobody waits for it any more.
        self._end = weakref.finalize(self, _end, self._child)
        with suppress(BrokenPipeError):  # `result` finds out how the process ended
            write(self._child.requests, pickle.dumps((GameText.of(game), budget)))

    def result(self) -> Strategy:
        """Wait for the strategy, and return it.

        Raises:
            BudgetError: It would take more than the budget.
            RuntimeError: The process ended without a strategy.
        """
        answer = None
        with suppress(EOFError):
            answer = read(self._child.answers)
        status = self._child.close()
        self._end.detach()
        if answer is None:
            raise RuntimeError(f"the process that makes a strategy {how_it_ended(status)}")
        content, effort = pickle.loads(answer)
        if content is None:
            raise BudgetError("more than the budget of states were to be looked at")
        made = decoded(content, self._game)
        return Strategy(self._game, made.choices, made.reached, effort)


def _end(child: PythonChild) -> None:
    child.kill()
    child.close()


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Make the strategy for a game that another process sends."""
    text, budget = pickle.loads(read(requests))
    answer: tuple[bytes | None, int] = None, 0
    with suppress(BudgetError):
        strategy = synthesise_anywhere(text.game(), budget)
        answer = encoded(strategy), strategy.effort
    write(answers, pickle.dumps(answer))
