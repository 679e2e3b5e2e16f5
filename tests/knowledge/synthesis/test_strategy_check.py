import numpy as np
import pytest
from games import random_game

from symaware_cli.knowledge.synthesis.strategy import Strategy, UnrealisableError, synthesise
from symaware_cli.knowledge.synthesis.strategy_check import Check


def is_wrong(strategy: Strategy, choices: np.ndarray, reached: np.ndarray, cells: list[int]) -> bool:
    """Whether a strategy is wrong, by looking for a bad lasso with plain searches."""
    game = strategy.game
    moves, own, goals = (
        game.moves,
        game.vocabulary.cell.following,
        game.goals(game.guarantees) or (np.ones(game.size, bool),),
    )
    assumed = game.goals(game.assumptions)
    values, possible = game.starts(cells)
    waiting = [(0, int(state)) for state in np.asarray(game.starting(values))[possible]]
    edges: dict[tuple[int, int], list[tuple[int, int]]] = {}
    while waiting:
        node = waiting.pop()
        if node in edges:
            continue
        goal, state = node
        after = own[game.values["cell"][state]]
        if choices[node] not in after or (reached[node] and not goals[goal][state]):
            return True
        answers = moves[list(after).index(choices[node])][:, state]
        if (answers == game.size + 1).any():
            return True
        following = (goal + 1) % len(choices) if reached[node] else goal
        edges[node] = sorted({(following, int(each)) for each in answers if each < game.size})
        waiting += edges[node]
    for goal_states in goals:
        inner = {
            node: [each for each in after if not goal_states[each[1]]]
            for node, after in edges.items()
            if not goal_states[node[1]]
        }
        reach: dict[tuple[int, int], set[tuple[int, int]]] = {}
        for node in inner:
            seen: set[tuple[int, int]] = set()
            stack = list(inner[node])
            while stack:
                one = stack.pop()
                if one not in seen:
                    seen.add(one)
                    stack += inner[one]
            reach[node] = seen
        for node in inner:
            component = [each for each in reach[node] if node in reach[each]]
            if node in reach[node] and all(any(goal[each[1]] for each in component) for goal in assumed):
                return True
    return False


@pytest.mark.parametrize("count", [20, pytest.param(100, marks=pytest.mark.slow)])
def test_mutated_strategies_that_are_wrong_are_rejected_and_others_are_not(count: int) -> None:
    wrong = right = 0
    seed = 0
    while wrong < count or right < count:
        draw = np.random.default_rng(seed)
        seed += 1
        game = random_game(draw)
        cells = list(game.vocabulary.cell.system.initial) if game.vocabulary.cell.system else []
        if game.size > 200:
            continue
        try:
            strategy = synthesise(game, cells)
        except UnrealisableError:
            continue
        for _ in range(4):
            choices, reached = strategy.choices.copy(), strategy.reached.copy()
            goal, state = int(draw.integers(len(choices))), int(draw.integers(game.size))
            if draw.random() < 0.8:
                choices[goal, state] = draw.integers(game.vocabulary.cell.size)
            else:
                reached[goal, state] = not reached[goal, state]
            fault = Check(game, choices, reached).fault(cells)
            expected = is_wrong(strategy, choices, reached, cells)
            assert (fault is not None) == expected, (seed, fault)
            wrong, right = wrong + expected, right + (not expected)
