"""Cells of maps are merged into rectangles."""

import numpy as np
import pytest
from numpy.typing import NDArray

from symaware_cli.maps.rectangles import merged


def covered(shape: tuple[int, int], marked: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the number of rectangles that cover each cell."""
    count = np.zeros(shape, np.intp)
    for x, y, right, top in merged(marked).tolist():
        count[y:top, x:right] += 1
    return count


def test_each_marked_cell_is_in_exactly_one_rectangle_and_no_other_cell_is() -> None:
    random = np.random.default_rng(7)
    for _ in range(100):
        rows, columns = random.integers(1, 20, 2)
        marked = random.random((rows, columns)) < random.random()
        assert np.array_equal(covered((rows, columns), marked), marked)


@pytest.mark.parametrize("turn", [0, 1, 2, 3])
def test_a_wall_along_an_axis_is_one_rectangle_and_a_room_four(turn: int) -> None:
    room = np.zeros((12, 30), bool)
    room[[0, -1]] = room[:, [0, -1]] = True
    assert len(merged(np.rot90(room, turn))) == 4
    comb = np.zeros((9, 9), bool)
    comb[:, ::2] = True
    comb[0] = True
    assert len(merged(np.rot90(comb, turn))) <= 9
    assert merged(np.ones((3, 5), bool)).tolist() == [[0, 0, 5, 3]]
    assert merged(np.zeros((3, 5), bool)).shape == (0, 4)
