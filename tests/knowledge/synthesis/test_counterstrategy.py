import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from games import PlainGame, game, random_game
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from symaware_cli import TransitionSystem
from symaware_cli.knowledge.synthesis.conflict import conflict
from symaware_cli.knowledge.synthesis.counterstrategy import Counterstrategy, oppose
from symaware_cli.knowledge.synthesis.game import Game, Statement
from symaware_cli.knowledge.synthesis.strategy import UnrealisableError, is_realisable, synthesise
from symaware_cli.knowledge.synthesis.vocabulary import Variable

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
def test_of_200_random_games_there_is_either_a_strategy_or_a_counterstrategy_that_beats_every_move() -> None:
    assert 30 < sum(complements(seed) for seed in range(200)) < 180


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
    assert [each.text for each in guilty.opposing] == ["always not right"]
    assert not guilty.helpful
    assert str(guilty) == (
        "`always eventually right` cannot be met: the agent must not make it impossible to keep `always not right`"
    )


#: Statements about a hall, some of which need others to be true.
ASSUMED = ["eventually open", "eventually not open", "eventually light", "eventually not light", "not right"]
GUARANTEED = [
    "always eventually right",
    "always eventually left",
    'always (not open implies not next (cell == "b"))',
    'always (open implies not next (cell == "b"))',
    'always (light implies not next (cell == "b"))',
]


def test_a_conflict_names_the_assumptions_without_which_fewer_guarantees_would_be_in_conflict() -> None:
    assumed = ["always eventually light", "always eventually open", "always eventually not open"]
    guilty = conflict(game(HALL, [Variable("open"), Variable("light")], assumed, GUARANTEED[:4]), [0])
    assert [each.text for each in guilty.guarantees] == [GUARANTEED[0], *GUARANTEED[2:4]]
    assert [each.text for each in guilty.helpful] == assumed[1:]
    assert not guilty.opposing
    assert str(guilty).endswith(
        "cannot be met together, though each part of them can given `always eventually open` and `always eventually "
        "not open`, without which a part would be in conflict already"
    )


def random_hall(draw: np.random.Generator) -> Game:
    assumed = [f"always {each}" for each in ASSUMED if draw.random() < (0.2 if each == "not right" else 0.8)]
    system = replace(HALL, initial=(0,))
    return game(system, [Variable("open"), Variable("light")], assumed, [e for e in GUARANTEED if draw.random() < 0.7])


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


def smaller(statements: Sequence[Statement]) -> Iterator[Sequence[Statement]]:
    """All sets of fewer statements."""
    for count in range(len(statements)):
        yield from itertools.combinations(statements, count)


@pytest.mark.parametrize("first", range(0, 300, 100))
def test_conflicts_of_random_games_are_irreducible_by_a_plain_fixpoint_over_all_subsets(first: int) -> None:
    found = helped = opposed = 0
    draws = [np.random.default_rng(seed) for seed in range(first, first + 100)]
    for one in [*map(random_game, draws), *map(random_hall, draws[:20])]:
        assert one.vocabulary.cell.system is not None
        cells = one.vocabulary.cell.system.initial
        if is_realisable(one, cells):
            continue
        guilty = conflict(one, cells)
        assumed = [each for each in one.assumptions if each in (*guilty.helpful, *guilty.opposing)]
        found += 1
        helped += bool(guilty.helpful)
        opposed += bool(guilty.opposing)
        for kept in (one.assumptions, assumed):
            assert not is_won(one, kept, guilty.guarantees)
            assert all(is_won(one, kept, fewer) for fewer in smaller(guilty.guarantees))
        for each in guilty.opposing:
            assert is_won(one, [other for other in assumed if other is not each], guilty.guarantees)
        for each in guilty.helpful:
            rest = [other for other in assumed if other is not each]
            assert not is_won(one, rest, guilty.guarantees)
            assert not all(is_won(one, rest, fewer) for fewer in smaller(guilty.guarantees))
    assert found > 30
    assert helped
    assert opposed
