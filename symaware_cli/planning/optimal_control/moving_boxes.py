"""Plans that stay outside of boxes that move, at the instants of the plan and on the straight ways between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.geometry import Array
from symaware_cli.planning.optimal_control.affine_predicate import Face
from symaware_cli.planning.optimal_control.specification_program import SpecificationProgram
from symaware_cli.specification import formula as stl

#: The outward normals of the sides of a box.
_SIDES = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))


def avoid_moving_box(
    program: SpecificationProgram, name: str, state: ArrayLike, centres: ArrayLike, half_sizes: ArrayLike
) -> bool:
    """Require that a position, the state of a program, stays outside of a square that moves.

    Both move straight between two instants. The position is then outside all the time if it is on the same side at both
    ends: the distance from a side is linear in time. If it is within the square at the present, it has to be outside at
    the next instant.

    Args:
        program: The program, of a model whose state is a position in the plane; a radius counts (`add_radius`).
        name: A name for the square.
        state: The present position; shape (2,) [m].
        centres: The centres of the square from the present on; shape (m, 2) [m].
        half_sizes: Half the lengths of its sides; shape (m,) [m].

    Returns:
        Whether this may be possible, as for `SpecificationProgram.require`.
    """
    middles, sizes = np.asarray(centres, float), np.asarray(half_sizes, float)
    normals = np.array(_SIDES)
    #: By which margin each side holds at the present.
    margins: Array = normals @ (np.asarray(state, float) - middles[0]) - sizes[0]
    possible = True
    for instant in range(min(len(middles) - 1, program.steps)):
        sets = []
        for normal in _SIDES:
            for place in (instant, instant + 1):
                offset = -float(np.array(normal) @ middles[place] + sizes[place])
                x, y = normal
                sets.append((Face(normal, offset), Face((-x, -y), -offset)))
        ends = [stl.Always(1, 1, stl.Predicate(2 * side + 1)) for side in range(len(_SIDES))]
        ways: list[stl.Formula] = list(ends)
        if instant or margins.max() >= 0.0:
            ways = [stl.And((stl.Predicate(2 * side), end)) for side, end in enumerate(ends)]
        possible &= program.require(f"{name} {instant}", stl.Or(tuple(ways)), sets, first=instant)
    return possible
