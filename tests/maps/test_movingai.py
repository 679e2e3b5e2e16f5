"""Maps and problems of Moving AI: valid files are read, and invalid ones are refused at the place of the problem."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from symaware_cli.language.build import Built
from symaware_cli.language.problem import Problem, ScenarioError
from symaware_cli.maps.movingai import read_map, read_problems
from symaware_cli.maps.path_search import PathSearch
from symaware_cli.maps.planning_grid import GridFrame, PlanningGrid

MAP = "type octile\nheight 3\nwidth 4\nmap\n....\n.@TW\nGS..\n"
PROBLEMS = "version 1\n0\troom.map\t4\t3\t0\t0\t3\t2\t5.00000000\n1 room.map 4 3 3 0 0 2 5\n"


def test_the_first_row_of_a_map_is_the_upper_one(tmp_path: Path) -> None:
    path = tmp_path / "room.map"
    path.write_text(MAP)
    raster, content = read_map(path, 0.5)
    assert raster.cells.tolist() == [[0, 0, 0, 0], [0, 1, 1, 1], [0, 0, 0, 0]]
    assert (raster.resolution, raster.origin, content) == (0.5, (0.0, 0.0), MAP.encode())


def test_the_length_of_a_problem_is_that_of_our_path(
    building: Callable[..., Built], room: Path, scenario: dict[str, Any]
) -> None:
    (room / "room.map").write_text(MAP)
    (room / "room.scen").write_text(PROBLEMS)
    scenario["map"] = {"file": "room.map"}
    scenario["agents"]["robot"]["state"] = [0.5, 0.5, 0.0]
    built = building(scenario)
    grid = PlanningGrid(GridFrame((0.0, 0.0), 0.0, 1.0, (3, 4)), built.simulation.environment.obstacles, 0.0, 0.0, 0.0)
    problems = read_problems(room / "room.scen")
    assert [(each.start, each.goal) for each in problems] == [((0, 2), (3, 0)), ((3, 2), (0, 0))]
    for start, goal, length in problems:
        path = PathSearch(grid).path(np.array(start) + 0.5, np.array(goal) + 0.5, 1000)
        assert path.cost == pytest.approx(length)


@pytest.mark.parametrize(
    ("text", "said", "line", "column"),
    [
        ("", "line 2 of a map says `height N`", 2, 1),
        (MAP.replace("octile", "tile"), "begins with `type octile`", 1, 1),
        (MAP.replace("height 3", "height three"), "line 2 of a map says `height N`", 2, 1),
        (MAP.replace("height 3", "height 0"), "a map has 1 to 4,000,000 cells", 2, 1),
        (MAP.replace("height 3", "height 9999999"), "a map has 1 to 4,000,000 cells", 2, 1),
        (MAP.replace("\nmap\n", "\nplan\n"), "line 4 of a map is `map`", 4, 1),
        (MAP.replace("GS..\n", ""), "there are 2 rows, and the height is 3", 6, 1),
        (MAP.replace(".@TW", ".@T"), "the row has 3 cells, and the width is 4", 6, 1),
        (MAP.replace(".@TW", ".@xW"), "`x` is no cell", 6, 3),
    ],
)
def test_a_bad_map_is_refused_at_its_place(
    text: str,
    said: str,
    line: int,
    column: int,
    problems: Callable[..., list[Problem]],
    room: Path,
    scenario: dict[str, Any],
) -> None:
    (room / "room.map").write_text(text)
    scenario["map"] = {"file": "room.map"}
    found = problems(scenario)[0]
    assert said in found.message
    assert found.span is not None
    assert (found.span.line, found.span.column) == (line, column)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("version 1", "version 2", "begins with `version 1`"),
        ("\t5.0", "", "a problem has 9 words"),
        ("\t5.0", "\tnan", "a problem has 9 words"),
        ("1 room.map 4 3 3 0", "1 room.map 4 3 4 0", "is not on the map of 4 x 3 cells"),
        ("1 room.map 4 3 3 0", "1 room.map 4 3 x 0", "are whole numbers"),
        ("0 2 5", "0 2 inf", "is not a finite number"),
    ],
)
def test_a_bad_file_of_problems_is_refused(old: str, new: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "room.scen"
    path.write_text(PROBLEMS.replace(old, new).replace("nan0000000", "nan 0000000"))
    with pytest.raises(ScenarioError) as caught:
        read_problems(path)
    assert said in caught.value.problems[0].message
