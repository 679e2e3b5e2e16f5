"""The progress of agents on their paths."""

import numpy as np

from symaware_cli.maps.path_progress import PathProgress, lengths_left

CORNERS = np.array([[[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]], [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]]])


def test_the_rest_of_a_path_begins_where_an_agent_is() -> None:
    places = np.array([[1.0, 1.0], [0.25, 0.0]])
    assert np.allclose(lengths_left(CORNERS, np.array([3, 2]), places), [5**0.5 + 4.0, 0.75])


def test_without_a_path_the_rest_is_zero() -> None:
    assert lengths_left(CORNERS, np.array([0, 2]), np.zeros((2, 2))).tolist() == [0.0, 1.0]
    assert lengths_left(np.zeros((2, 0)), np.zeros(2, np.intp), np.zeros((2, 2))).tolist() == [0.0, 0.0]


def test_only_a_step_towards_the_end_counts_as_progress() -> None:
    progress = PathProgress.none(2).after(np.array([5.0, 5.0]), 1, 0.5).after(np.array([4.6, 4.5]), 2, 0.5)
    assert progress.since.tolist() == [1, 2]
    assert progress.left.tolist() == [5.0, 4.5]
    again = progress.restarted(np.array([0]), 3)
    assert again.since.tolist() == [3, 2]
    assert again.after(np.array([9.0, 4.5]), 4, 0.5).since.tolist() == [4, 2]
