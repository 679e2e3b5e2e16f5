"""Jump points: the cells at which shortest paths on a planning grid may have to branch.

D. Harabor and A. Grastien, Online graph pruning for pathfinding on grid maps, AAAI 2011. Their rules are for grids
whose moves follow from the cells that are occupied. Here a move may be impossible between two passable cells, so the
rules are stated about moves: from a cell that was reached by a move, another move is pruned if both together can be
replaced, at most two moves around the cell, by a shorter way, or by one of the same length whose diagonal comes first.
So among the paths of least cost, the one with its diagonals first is never pruned.
"""

from __future__ import annotations

from collections.abc import Container

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry.vectors import Indices, Mask
from symaware_cli.maps.planning_grid import MOVES, PlanningGrid

Bits = NDArray[np.uint8]


class JumpPoints:
    """The moves that remain after each move, and jumps along them.

    Attributes:
        onward: For each of the eight moves, the moves from each cell that are worth considering after it; bits as those
            of `PlanningGrid.moves`; shape (8, n).
    """

    def __init__(self, grid: PlanningGrid) -> None:
        """Prune the moves of a grid."""
        self._columns = grid.frame.shape[1]
        self._moves = grid.moves
        self._changes = [row * self._columns + column for column, row in MOVES]
        self.onward: Bits = np.stack([self._pruned(bit) for bit in range(8)])
        #: The two components of each diagonal move.
        self._components: list[tuple[int, ...]] = [(bit - 1, (bit + 1) % 8) if bit % 2 else () for bit in range(8)]
        #: Whether a path may have to turn at a cell that it reached by a move.
        self._turns: list[list[bool]] = []
        self._continues: list[list[bool]] = []
        for bit in range(8):
            natural = 1 << bit
            for component in self._components[bit]:
                natural |= 1 << component
            self._turns.append((self.onward[bit] & (255 ^ natural) != 0).tolist())
            self._continues.append((self.onward[bit] >> bit & 1 != 0).tolist())
        self._onward: list[list[int]] = self.onward.tolist()
        #: The list of moves for each combination of bits.
        self._bits = [[move for move in range(8) if bits >> move & 1] for bits in range(256)]

    def directions(self, cell: int, arrived: int) -> list[int]:
        """Return the moves to consider from a cell that was reached by a move; for a start (-1), all possible moves."""
        return self._bits[int(self._moves[cell]) if arrived < 0 else self._onward[arrived][cell]]

    def jump(self, cell: int, bit: int, ends: Container[int]) -> tuple[int, int]:
        """Repeat a possible move until a cell where a path may turn or end.

        Args:
            cell: The first cell.
            bit: The move.
            ends: The cells at which paths may end.

        Returns:
            That cell and the number of moves; -1 for the cell if there is none before an obstacle.
        """
        change, turns, continues = self._changes[bit], self._turns[bit], self._continues[bit]
        components, steps = self._components[bit], 0
        while True:
            cell += change
            steps += 1
            if turns[cell] or cell in ends:
                return cell, steps
            for component in components:
                if self._onward[bit][cell] >> component & 1 and self.jump(cell, component, ends)[0] >= 0:
                    return cell, steps
            if not continues[cell]:
                return -1, steps

    def _pruned(self, bit: int) -> Bits:
        """Return the moves from each cell that are left after a move; shape (n,)."""
        kept = self._moves & np.uint8(255 ^ (1 << (bit + 4) % 8))
        came = MOVES[bit]
        parent = np.arange(len(kept)) - self._changes[bit]
        reached = self._has(parent, bit)
        for turn in range(8):
            if turn == (bit + 4) % 8:
                continue
            to = (came[0] + MOVES[turn][0], came[1] + MOVES[turn][1])
            replaced = np.zeros(len(kept), bool)
            if to in MOVES:
                replaced |= self._has(parent, MOVES.index(to))
            for first, (column, row) in enumerate(MOVES):
                second = (to[0] - column, to[1] - row)
                if first == bit or second not in MOVES:
                    continue
                other = MOVES.index(second)
                diagonals, instead = bit % 2 + turn % 2, first % 2 + other % 2
                if instead < diagonals or (instead == diagonals and first % 2 > bit % 2):
                    replaced |= self._has(parent, first) & self._has(parent + self._changes[first], other)
            kept = np.where(reached & replaced, kept & np.uint8(255 ^ (1 << turn)), kept)
        return kept

    def _has(self, cells: Indices, bit: int) -> Mask:
        """Return whether a move is possible from cells, some of which do not exist."""
        inside = (cells >= 0) & (cells < len(self._moves))
        found: Mask = inside & (self._moves[np.where(inside, cells, 0)] >> bit & 1 != 0)
        return found
