"""The run of the publication: visits, lengths of the paths, and every accepted specification."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from warehouse_runs import run

from symaware_cli import Log

#: Lengths of the paths in the publication [m].
LENGTHS = (91.6, 155.3, 5.0, 156.5)
#: What the robots enter in the publication, and when [s]; home is where they start.
VISITS: tuple[dict[str, list[int]], ...] = (
    {"pickup": [9], "collect_2": [16]},
    {"pickup": [10, 25], "collect_3": [17], "collect_1": [34]},
    {},
    {"pickup": [11, 25], "collect_1": [19], "collect_2": [34]},
)
PLACES = {
    "pickup": (30, 40, 0, 10),
    "collect_1": (5, 10, 35, 40),
    "collect_2": (15, 20, 35, 40),
    "collect_3": (25, 30, 35, 40),
}


@pytest.fixture(scope="module")
def log() -> Log:
    return run("as-recorded.yaml")


def path(log: Log, robot: int) -> NDArray[np.float64]:
    return log.series(f"robot.{robot}", "world").values[:, :2]


def test_every_specification_is_satisfied(log: Log) -> None:
    assert {each.name: each.verdict for each in log.outcomes} == {each.name: "satisfied" for each in log.outcomes}
    assert len(log.outcomes) == 10


@pytest.mark.parametrize("robot", range(4))
def test_a_path_is_as_long_as_that_of_the_publication(log: Log, robot: int) -> None:
    length = np.linalg.norm(np.diff(path(log, robot), axis=0), axis=1).sum()
    assert length == pytest.approx(LENGTHS[robot], rel=0.05)


@pytest.mark.parametrize("robot", range(4))
def test_a_robot_visits_the_regions_of_the_publication_at_most_a_step_apart(log: Log, robot: int) -> None:
    x, y = path(log, robot).T
    found = {}
    for name, (left, right, low, high) in PLACES.items():
        inside = (x >= left) & (x <= right) & (y >= low) & (y <= high)
        entered = np.flatnonzero(inside & ~np.append(False, inside[:-1])).tolist()
        if entered:
            found[name] = entered
    assert found.keys() == VISITS[robot].keys()
    for name, times in VISITS[robot].items():
        assert np.abs(np.array(found[name]) - times).max() <= 1, name
