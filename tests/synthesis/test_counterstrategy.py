from collections.abc import Sequence

import numpy as np
import pytest
from games import PlainGame, game, random_game
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from symaware_cli import TransitionSystem
from symaware_cli.synthesis.conflict import conflict
from symaware_cli.synthesis.counterstrategy import Counterstrategy, oppose
from symaware_cli.synthesis.game import Game, Statement
from symaware_cli.synthesis.strategy import UnrealisableError, is_realisable, synthesise
from symaware_cli.synthesis.vocabulary import Variable

Node = tuple[int, int]

HALL = TransitionSystem.of(
    {"a": ["a", "b"], "b": ["b", "a", "c"], "c": ["c", "b"]}, labels={"left": ["a"], "right": ["c"]}
)


def played(counter: Counterstrategy, plain: PlainGame) -> tuple[list[Node], list[tuple[int, int]]]:
    """Play the counterstrategy against every move of the agent, from every state that it covers.

    Returns:
        Where play can come to, and the steps between them, by their places in that list.
    """
    nodes: list[Node] = [(state, 0) for state in range(len(plain.states)) if counter.covers(state)]
    place = {node: number for number, node in enumerate(nodes)}
    steps = []
    for number, node in enumerate(nodes):  # grows meanwhile
        state = plain.states[node[0]]
        for cell in plain.variables[-1].following[state[0][-1]]:
            legal = [answers for answers in plain.moves[state] if any(each and each[0][-1] == cell for each in answers)]
            after, goal = counter.answer(node[0], node[1], cell)
            if after is None:
                assert all(None in answers for answers in legal)  # that choice breaks a guarantee
                continue
            assert len(legal) == 1
            assert plain.states[after] in legal[0]
            if (after, goal) not in place:
                place[after, goal] = len(nodes)
                nodes.append((after, goal))
            steps.append((number, place[after, goal]))
    return nodes, steps


def loops(count: int, steps: list[tuple[int, int]]) -> list[set[int]]:
    """Return the strongly connected parts of a graph that have a step within them."""
    start, end = np.array(steps, np.intp).reshape(-1, 2).T
    graph = coo_array((np.ones(len(start)), (start, end)), (count, count))
    _, part = connected_components(graph, connection="strong")
    cyclic = sorted(set(part[start[part[start] == part[end]]].tolist()))
    return [set(np.flatnonzero(part == each).tolist()) for each in cyclic]


def is_beaten(counter: Counterstrategy, plain: PlainGame) -> bool:
    """Whether in every infinite play all goals of the environment are met for ever, and not all of the agent's."""
    nodes, steps = played(counter, plain)
    if not steps:
        return True
    states = [plain.states[state] for state, _ in nodes]
    for goal in plain.goals(plain.assumed):
        if loops(len(nodes), [step for step in steps if not any(goal(states[each]) for each in step)]):
            return False
    wanted = plain.goals(plain.guaranteed)
    return not any(
        all(any(goal(states[each]) for each in part) for goal in wanted) for part in loops(len(nodes), steps)
    )


def complements(seed: int) -> bool:
    """Check one random game; return whether the agent has a strategy."""
    one = random_game(np.random.default_rng(seed))
    plain = PlainGame(one)
    counter = oppose(one)
    winning = plain.winning()
    assert [state in winning for state in plain.states] == [not counter.covers(place) for place in range(one.size)]
    assert is_beaten(counter, plain), seed
    cells = list(one.vocabulary.cell.system.initial) if one.vocabulary.cell.system else []
    try:
        synthesise(one, cells)
    except UnrealisableError:
        assert not any(one.starts([cell])[1].any() for cell in cells) or any(is_lost(counter, each) for each in cells)
        return False
    assert not any(is_lost(counter, each) for each in cells)
    return True


def is_lost(counter: Counterstrategy, cell: int) -> bool:
    """Whether the environment wins if the agent begins in a cell."""
    if not counter.game.starts([cell])[1].any():
        return False
    state = counter.beginning(cell)
    return state is None or counter.covers(state)


def test_there_is_either_a_strategy_or_a_counterstrategy_that_beats_every_move() -> None:
    assert 10 < sum(complements(seed) for seed in range(60)) < 50  # of both kinds


@pytest.mark.slow
def test_of_1000_random_games_there_is_either_a_strategy_or_a_counterstrategy_that_beats_every_move() -> None:
    assert 150 < sum(complements(seed) for seed in range(1000)) < 900


def test_the_environment_keeps_its_own_promises_while_it_prevents_a_goal() -> None:
    # The agent goes to and fro between the left and the middle; the door is open only while it is on the left.
    stated = [
        "always (not open implies not next right)",
        "always (not left implies next (left or right))",
        "always eventually right",
    ]
    one = game(HALL, [Variable("open")], ["always eventually open"], stated)
    counter = oppose(one)
    assert is_lost(counter, 0)
    assert is_beaten(counter, PlainGame(one))


def test_a_conflict_names_the_guarantees_and_the_assumptions_without_which_there_would_be_none() -> None:
    one = game(
        HALL,
        [Variable("open")],
        ["always eventually open", "always not right"],  # a cell in which the environment has no answer is no choice
        ["always eventually left", "always eventually right"],
    )
    guilty = conflict(one, [0])
    assert [each.text for each in guilty.guarantees] == ["always eventually right"]
    assert [each.text for each in guilty.assumptions] == ["always not right"]


def is_won(of: Game, assumptions: Sequence[Statement], guarantees: Sequence[Statement]) -> bool:
    """Whether all beginnings that keep some assumptions are won, by a plain fixpoint."""
    one = Game(of.vocabulary, assumptions, guarantees)
    plain = PlainGame(one)
    assert one.vocabulary.cell.system is not None
    values, possible = one.starts(one.vocabulary.cell.system.initial)
    kept = one.holds_at_start(one.guarantees, values)
    winning = plain.winning()
    every = [dict(zip(values, each, strict=True)) for each in np.array(list(values.values())).T.tolist()]
    remembered = [False] * len(plain.remembered)
    won = [(tuple(each[name] for name in plain.names), plain.bits(remembered, each)) in winning for each in every]
    return bool(possible.any() and (won & kept)[possible].all())


@pytest.mark.parametrize("first", range(0, 300, 100))
def test_conflicts_of_random_games_are_irreducible_by_a_plain_fixpoint(first: int) -> None:
    found = 0
    for seed in range(first, first + 100):
        one = random_game(np.random.default_rng(seed))
        assert one.vocabulary.cell.system is not None
        cells = one.vocabulary.cell.system.initial
        if is_realisable(one, cells):
            continue
        guilty = conflict(one, cells)
        found += 1
        assert not is_won(one, one.assumptions, guilty.guarantees)
        assert not is_won(one, guilty.assumptions, guilty.guarantees)
        for each in guilty.guarantees:
            assert is_won(one, one.assumptions, [other for other in guilty.guarantees if other is not each])
        for each in guilty.assumptions:
            assert is_won(one, [other for other in guilty.assumptions if other is not each], guilty.guarantees)
    assert found > 20
