import numpy as np
import pytest
from games import PlainGame, game, random_game

from symaware_cli import TransitionSystem
from symaware_cli.knowledge.synthesis.game import GameSizeError
from symaware_cli.knowledge.synthesis.game_solver import solve
from symaware_cli.knowledge.synthesis.strategy import UnrealisableError, synthesise
from symaware_cli.knowledge.synthesis.strategy_check import Check
from symaware_cli.knowledge.synthesis.vocabulary import Variable

HALL = TransitionSystem.of(
    {"a": ["a", "b"], "b": ["b", "a", "c"], "c": ["c", "b"]}, labels={"left": ["a"], "right": ["c"]}
)


def agrees(seed: int) -> bool:
    """Compare one random game with plain fixpoints; return whether there is a strategy, which is checked."""
    one = random_game(np.random.default_rng(seed))
    plain = PlainGame(one)
    solution = solve(one)
    found = {state for place, state in enumerate(plain.states) if solution.winning[place]}
    assert found == plain.winning(), seed
    cells = list(one.vocabulary.cell.system.initial) if one.vocabulary.cell.system else []
    try:
        strategy = synthesise(one, cells)
    except UnrealisableError:
        return False
    assert Check(one, strategy.choices, strategy.reached).fault(cells) is None
    return True


def test_winning_states_are_those_of_plain_fixpoints() -> None:
    won = sum(agrees(seed) for seed in range(40))
    assert 5 < won < 35  # of both kinds


@pytest.mark.slow
def test_winning_states_of_200_random_games_are_those_of_plain_fixpoints() -> None:
    assert 30 < sum(agrees(seed) for seed in range(200)) < 180


def test_an_agent_waits_for_what_is_assumed_to_happen_again_and_again() -> None:
    stated = ["always (not open implies not next right)", "always eventually right", "always eventually left"]
    closed = game(HALL, [Variable("open")], [], stated)
    with pytest.raises(UnrealisableError, match="cell a, open false"):
        synthesise(closed, [0])
    strategy = synthesise(game(HALL, [Variable("open")], ["always eventually open"], stated), [0])
    at_b = {
        opened: int(strategy.game.index({"cell": np.array([1]), "open": np.array([opened])}, [])[0])
        for opened in (0, 1)
    }
    assert strategy.choice(at_b[0], 0) == (1, 0)  # waits
    assert strategy.choice(at_b[1], 0) == (2, 0)  # goes right


def test_the_agent_commits_itself_before_it_sees_the_next_move_of_the_environment() -> None:
    with pytest.raises(UnrealisableError):
        synthesise(game(HALL, [Variable("red")], [], ["always not (red and right)", "always eventually right"]), [0])
    synthesise(
        game(HALL, [Variable("red")], ["always not red"], ["always not (red and right)", "always eventually right"]),
        [0],
    )


def test_an_agent_does_not_win_by_making_the_assumptions_impossible() -> None:
    # In the cell on the right no answer is left to the environment.
    with pytest.raises(UnrealisableError):
        synthesise(game(HALL, [Variable("red")], ["always not right"], ["always eventually (red and not red)"]), [0])


def test_a_response_answers_every_request() -> None:
    strategy = synthesise(
        game(HALL, [Variable("call")], [], ["always (call implies eventually right)", "always eventually left"]), [0]
    )
    assert len(strategy.choices) == 2


def test_a_game_that_is_too_large_is_refused() -> None:
    ring = TransitionSystem.of({f"s{each}": [f"s{(each + 1) % 1000}", f"s{each}"] for each in range(1000)})
    with pytest.raises(GameSizeError, match="1,000,000,000 states"):
        game(ring, [Variable("one", ring), Variable("other", ring)], [], ["always eventually one == other"])
