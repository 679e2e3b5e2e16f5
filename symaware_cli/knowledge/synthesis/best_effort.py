"""Strategies where no strategy wins: the agent heads for its goals as if the environment might let it through."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symaware_cli.knowledge.synthesis.game import Game
from symaware_cli.knowledge.synthesis.game_solver import solve
from symaware_cli.knowledge.synthesis.move_graph import MoveGraph
from symaware_cli.knowledge.synthesis.strategy import Strategy


def best_effort_strategy(game: Game) -> Strategy:
    """Make a strategy that wins from the states from which that is possible, and tries to from the others.

    There, the agent prefers a choice after which no answer breaks a guarantee at once, and of those one after which
    some answer brings it nearer to its goal.
    """
    solution, graph = solve(game), MoveGraph(game)
    goals = np.array(game.goals(game.guarantees) or (np.ones(game.size, bool),))
    tried = np.stack([_nearer(game, graph, goal) for goal in goals])
    for number, goal in enumerate(goals):  # where a goal is met, the next one is pursued
        tried[number, goal] = tried[(number + 1) % len(goals), goal]
    return Strategy(game, np.where(solution.winning, solution.choices, tried), goals)


def _nearer(game: Game, graph: MoveGraph, goal: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return the cell to choose in each state, -1 where the agent has no move; shape (size,)."""
    distance = np.full(game.size + 2, game.size, np.int32)  # after the last state: what must not happen
    fresh, count = np.flatnonzero(goal), 0
    while len(fresh):
        distance[fresh] = count
        fresh = graph.preceding(fresh, distance[:-2] == game.size)
        count += 1
    choices = np.full(game.size, -1, np.int32)
    best = np.full(game.size, -1)
    following = game.vocabulary.cell.following
    for option, answers in enumerate(game.moves):
        chosen = np.array([each[option] if option < len(each) else -1 for each in following])[game.values["cell"]]
        safe = (answers != game.size + 1).all(axis=0)
        nearer = (distance[answers] < distance[:-2]).any(axis=0)
        score = np.where(chosen >= 0, 2 * safe + nearer, -1)
        better = score > best
        choices[better], best[better] = chosen[better], score[better]
    return choices
