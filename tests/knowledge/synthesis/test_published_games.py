"""Games of the literature: arbiters and lift controllers."""

import runpy
from collections.abc import Callable

import pytest
from checkout import CHECKOUT

from symaware_cli.knowledge.synthesis.fragment import clauses
from symaware_cli.knowledge.synthesis.game import Game, Statement
from symaware_cli.knowledge.synthesis.strategy import UnrealisableError, synthesise

GAMES: dict[str, Callable[[int], Game]] = runpy.run_path(str(CHECKOUT / "benchmarks" / "published_games.py"))


@pytest.mark.parametrize(
    ("name", "size", "states"), [("arbiter", 2, 48), ("arbiter", 4, 1_280), ("lift", 2, 8), ("lift", 5, 160)]
)
def test_published_games_have_strategies(name: str, size: int, states: int) -> None:
    strategy = synthesise(GAMES[name](size), [0])  # which is checked by the model checker
    assert strategy.game.size == states
    assert len(strategy.choices) == size


@pytest.mark.parametrize(("name", "neglected"), [("arbiter", "always not g1"), ("lift", "always not f1")])
def test_there_is_none_if_a_line_or_a_floor_is_never_to_be_served(name: str, neglected: str) -> None:
    game = GAMES[name](3)
    more = Statement(neglected, clauses(neglected, game.vocabulary))
    with pytest.raises(UnrealisableError):
        synthesise(Game(game.vocabulary, game.assumptions, [*game.guarantees, more]), [0])
