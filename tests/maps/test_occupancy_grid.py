"""Occupancy grids, against rays that are followed cell by cell."""

import numpy as np
import pytest

from symaware_cli.maps.occupancy_grid import OccupancyModel
from symaware_cli.maps.planning_grid import GridFrame
from symaware_cli.maps.raster import FREE, OCCUPIED, UNKNOWN

MODEL = OccupancyModel(hit=0.7, miss=0.4, certain=0.97, occupied=0.65, free=0.35)
FRAME = GridFrame((0.0, 0.0), 0.0, 0.5, (8, 12))


def seen(ends: list[list[float]], is_hit: list[bool], times: int = 1) -> np.ndarray:
    """Return the cells after equal scans from one place."""
    odds = np.zeros(96, np.float32)
    for _ in range(times):
        odds = MODEL.updated(odds, FRAME, np.array([0.25, 0.25]), np.array(ends, float), np.array(is_hit))
    return MODEL.cells(odds, FRAME)


def test_a_ray_frees_the_cells_on_its_way_and_occupies_the_one_behind_its_end() -> None:
    cells = seen([[3.0, 0.25]], [True], times=3)
    assert cells[0].tolist() == [FREE] * 6 + [OCCUPIED] + [UNKNOWN] * 5
    assert (cells[1:] == UNKNOWN).all()


def test_a_ray_without_a_return_frees_cells_up_to_the_range_of_the_lidar() -> None:
    cells = seen([[3.0, 0.25]], [False], times=3)
    assert cells[0].tolist() == [FREE] * 6 + [UNKNOWN] * 6


def test_one_scan_alone_makes_a_cell_occupied_and_not_yet_free() -> None:
    cells = seen([[3.0, 0.25]], [True])
    assert cells[0].tolist() == [UNKNOWN] * 6 + [OCCUPIED] + [UNKNOWN] * 5


def test_many_rays_through_a_cell_count_once_in_a_scan() -> None:
    once = MODEL.updated(
        np.zeros(96, np.float32), FRAME, np.array([0.25, 0.25]), np.array([[3.0, 0.25]]), np.array([False])
    )
    often = MODEL.updated(
        np.zeros(96, np.float32), FRAME, np.array([0.25, 0.25]), np.array([[3.0, 0.25]] * 9), np.array([False] * 9)
    )
    assert np.array_equal(once, often)
    assert once.min() == pytest.approx(np.log(0.4 / 0.6))


def test_beliefs_stay_within_the_greatest_certainty_so_that_they_can_be_revised() -> None:
    odds = np.zeros(96, np.float32)
    for hit, times in ((True, 100), (False, 100)):
        for _ in range(times):
            odds = MODEL.updated(odds, FRAME, np.array([0.25, 0.25]), np.array([[3.4, 0.25]]), np.array([hit]))
            assert np.abs(odds).max() <= np.log(0.97 / 0.03) + 1e-6
    assert MODEL.cells(odds, FRAME)[0, 6] == FREE


def test_rays_beyond_the_grid_change_nothing_there() -> None:
    assert (seen([[-5.0, 0.25], [0.25, -5.0]], [True, True], 3)[1:, 1:] == UNKNOWN).all()


def test_every_cell_that_a_long_piece_of_a_ray_crosses_is_free() -> None:
    random = np.random.default_rng(3)
    for end in random.uniform(0.5, 3.9, (20, 2)):
        cells = seen([end.tolist()], [False], times=3)
        points = np.array([0.25, 0.25]) + np.linspace(0.0, 1.0, 2000, endpoint=False)[:, None] * (end - 0.25)
        crossed, counts = np.unique(np.floor(points / 0.5).astype(int), axis=0, return_counts=True)
        length = counts * np.hypot(*(end - 0.25)) / 2000
        assert (cells[tuple(crossed[length > 0.25][:, ::-1].T)] == FREE).all()
        assert (cells == FREE).sum() <= len(crossed)
