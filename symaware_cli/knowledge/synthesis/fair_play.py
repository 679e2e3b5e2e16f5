"""Whether an environment can keep its assumptions at all, if the agent helps it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from symaware_cli.knowledge.synthesis.game import Game

#: The greatest number of moves of a game that is examined.
_MOST_MOVES = 2_000_000


def can_be_kept(game: Game, cells: Sequence[int]) -> bool:
    """Return whether some play of a game without guarantees keeps its assumptions for ever.

    That is so if a strongly connected part of its moves, which begins in reach of a start, has a state for each goal.

    Args:
        game: The game, of assumptions only.
        cells: The cells in which the agent begins.

    Returns:
        Whether there is such a play; true also for a game that is too large to be examined.
    """
    variables = (*game.vocabulary.environment, game.vocabulary.cell)
    moves = math.prod((game.size, *(max(map(len, each.following)) for each in variables)))
    if not game.assumptions or moves > _MOST_MOVES:
        return True
    values, holds = game.starts(cells)
    if not holds.any():
        return False
    ahead = game.moves.reshape(-1, game.size)
    move, state = np.nonzero(ahead < game.size)
    after = ahead[move, state]
    graph = csr_array((np.ones(len(state), np.int8), (state, after)), shape=(game.size, game.size))
    _, part = connected_components(graph, directed=True, connection="strong")
    inner = part[state] == part[after]
    count = int(part.max()) + 1
    lasting = np.zeros(count, bool)
    lasting[part[state[inner]]] = True
    for goal in game.goals(game.assumptions):
        lasting &= np.bincount(part[goal], minlength=count) > 0
    reached: NDArray[np.bool_] = np.zeros(game.size, bool)
    for start in np.unique(game.starting(values)[holds]).tolist():
        if not reached[start]:
            reached[breadth_first_order(graph, start, return_predecessors=False)] = True
    return bool(lasting[part[reached]].any())
