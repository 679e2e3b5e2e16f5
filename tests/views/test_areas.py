"""Signals that are drawn as areas of the ground."""

import numpy as np
import pytest

from symaware_cli.views.scene.areas import _strips


@pytest.mark.parametrize(
    ("box", "lines"),
    [
        ([0.0, 2.0, 0.0, 0.5], [[[0.25, 0.25], [1.75, 0.25]]]),
        ([0.0, 0.5, 1.0, 3.0], [[[0.25, 1.25], [0.25, 2.75]]]),
        ([0.0, 2.0, 0.0, 1.0], [[[0.25, 0.25], [1.75, 0.25]], [[0.25, 0.75], [1.75, 0.75]]]),
    ],
)
def test_a_box_is_covered_by_strips_along_its_longer_side(box: list[float], lines: list[list[list[float]]]) -> None:
    assert _strips(np.array([box]), 0.5).tolist() == lines


def test_of_many_boxes_each_is_covered_and_nothing_else() -> None:
    random = np.random.default_rng(1)
    low = random.integers(0, 20, (30, 2)) * 0.5
    high = low + random.integers(1, 6, (30, 2)) * 0.5
    boxes = np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1)
    strips = _strips(boxes, 0.5)
    size = np.abs(strips[:, 1] - strips[:, 0]).sum(axis=1) + 0.5
    assert (0.5 * size).sum() == pytest.approx(np.prod(high - low, axis=1).sum())
