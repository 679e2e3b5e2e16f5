"""Makes a strategy in a process of its own, while the run goes on."""

from __future__ import annotations

import pickle
import subprocess
import sys
import weakref
from contextlib import suppress
from typing import NamedTuple

from symaware_cli.abstraction.transition_system import TransitionSystem
from symaware_cli.synthesis.fragment import clauses
from symaware_cli.synthesis.game import Game, Statement
from symaware_cli.synthesis.move_graph import BudgetError
from symaware_cli.synthesis.strategy import Strategy, synthesise_anywhere
from symaware_cli.synthesis.strategy_cache import StrategyCache, decoded, encoded
from symaware_cli.synthesis.vocabulary import Variable, Vocabulary


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
        self._process = subprocess.Popen(
            [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import main; main()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        #: Ends the process if nobody waits for it any more, at the latest with this one.
        self._end = weakref.finalize(self, self._process.kill)
        assert self._process.stdin is not None
        pickle.dump((GameText.of(game), budget), self._process.stdin)
        self._process.stdin.close()

    def result(self) -> Strategy:
        """Wait for the strategy, and return it.

        Raises:
            BudgetError: It would take more than the budget.
            RuntimeError: The process ended without a strategy.
        """
        assert self._process.stdout is not None
        with self._process.stdout as answers:
            answer = answers.read()
        status = self._process.wait()
        self._end.detach()
        if status != 0:
            raise RuntimeError(f"the process that makes a strategy ended with the status {status}")
        content, effort = pickle.loads(answer)
        if content is None:
            raise BudgetError("more than the budget of states were to be looked at")
        made = decoded(content, self._game)
        return Strategy(self._game, made.choices, made.reached, effort)


def main() -> None:
    """Make the strategy for the game on the standard input, and write it to the standard output."""
    text, budget = pickle.load(sys.stdin.buffer)
    answer: tuple[bytes | None, int] = None, 0
    with suppress(BudgetError):
        strategy = synthesise_anywhere(text.game(), StrategyCache.of_user(), budget)
        answer = encoded(strategy), strategy.effort
    sys.stdout.buffer.write(pickle.dumps(answer))
