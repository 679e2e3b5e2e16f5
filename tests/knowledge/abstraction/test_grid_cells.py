import numpy as np
import pytest

from symaware_cli.geometry.region import Region
from symaware_cli.knowledge.abstraction.grid_cells import GridCells

REGIONS = {
    "arena": Region(box=(0, 4, 0, 3)),
    "wall": Region(box=(1, 2, 0, 2)),
    "pillar": Region.model_validate({"circle": {"centre": [3.5, 2.5], "radius": 0.3}}),
    "ramp": Region(polygon=((0, 3), (0, 1.9), (1, 3))),
    "west": Region(box=(0, 2, 0, 3)),
    "free": Region.model_validate({"complement": "west"}),
}


def grid(**given: object) -> GridCells:
    made = GridCells(GridCells.Parameters.model_validate({"cell": 1.0, "region": "arena", **given}))
    made.prepare(REGIONS)
    return made


def test_cells_do_not_overlap_obstacles_but_may_touch_them() -> None:
    assert len(grid().system.states) == 12
    assert set(grid().system.states) - set(grid(obstacles=["wall"]).system.states) == {"c1_0", "c1_1"}
    assert set(grid().system.states) - set(grid(obstacles=["pillar"]).system.states) == {"c3_2"}
    assert set(grid().system.states) - set(grid(obstacles=["ramp"]).system.states) == {"c0_1", "c0_2"}


def test_cells_keep_the_margin_from_obstacles() -> None:
    left = grid(obstacles=["wall"], margin=0.2).system.states
    assert set(left) == {"c3_0", "c3_1", "c3_2"}


def test_cells_are_labelled_with_the_regions_that_contain_them() -> None:
    system = grid().system
    assert {system.states[each] for each in system.labels["wall"]} == {"c1_0", "c1_1"}
    assert {system.states[each] for each in system.labels["free"]} == {f"c{x}_{y}" for x in (2, 3) for y in range(3)}
    assert not system.labels["pillar"]


def test_transitions_lead_to_the_cells_that_share_a_side_or_stay() -> None:
    system = grid(obstacles=["wall"]).system
    place = system.states.index("c0_1")
    assert [system.states[each] for each in system.successors[place]] == ["c0_1", "c0_2", "c0_0"]


def test_points_are_found_in_cells() -> None:
    cells = grid()
    points = np.array([[0.5, 0.5, 9.0], [3.999, 2.999, 0.0], [4.5, 1.0, 0.0]])
    assert cells.cells(points).tolist() == [0, 11, -1]
    assert cells.gate(0, 1).tolist() == [1.0, 0.5]
    assert cells.centre(11).tolist() == [3.5, 2.5]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"region": "nowhere"}, "there is no region `nowhere`"),
        ({"region": "pillar"}, "`pillar` is not a box"),
        ({"cell": 0.7}, "cells of 0.7 m do not fill the region `arena`: it extends over 4 m along x"),
        ({"cell": 0.01}, "there would be 120,000 cells"),
        ({"obstacles": ["arena"]}, "obstacles cover every cell"),
    ],
)
def test_an_impossible_construction_is_explained(given: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        grid(**given)
