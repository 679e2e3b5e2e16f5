"""Maps in scenarios: as bodies of every world, as regions, and in the log."""

import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from map_files import YAML, picture

import symaware_cli as sa
from symaware_cli.language.build import Built
from symaware_cli.language.problem import Problem
from symaware_cli.specification.region import PlacedRegion


def clearances(built: Built, points: list[tuple[float, float]]) -> list[float]:
    near = built.simulation.environment.scenery.nearest(np.array(points), 5.0)
    return [float(near.distance[near.row == row].min()) for row in range(len(points))]


def depth(built: Built, name: str, *points: tuple[float, float]) -> list[float]:
    regions = built.simulation.groups[0].regions
    placed = PlacedRegion(name, regions, lambda _: (np.full(2, np.nan), None))
    return [float(each) for each in placed.robustness(np.array(points))]


def test_occupied_cells_become_few_boxes_where_they_are(building: Callable[..., Built]) -> None:
    built = building()
    scenery = built.simulation.environment.scenery
    assert len(built.simulation.environment.obstacles) == 6, "four walls, one in two parts, and a pillar"
    places = [(1.0, 1.0), (2.7, 1.0), (2.7, 0.3)]  # beside a pillar, in a door, and in the wall below the door
    assert clearances(built, places) == pytest.approx([0.2, 0.2, -0.1])
    assert len(scenery) == 6


def test_regions_hold_where_cells_are_free_occupied_or_unknown(building: Callable[..., Built]) -> None:
    built = building()
    assert depth(built, "free", (0.6, 1.0), (1.3, 1.0), (0.3, 0.3), (9.0, 1.0)) == pytest.approx(
        [0.4, -0.1, -0.1, -6.2]
    )
    assert depth(built, "occupied", (0.1, 1.0), (0.6, 1.0)) == pytest.approx([0.1, -0.4])
    assert depth(built, "unknown", (0.3, 0.3)) == pytest.approx([0.1])


def test_a_map_may_be_moved_and_turned(building: Callable[..., Built], room: Path, scenario: dict[str, Any]) -> None:
    quarter = {**YAML, "origin": [1.0, 2.0, math.pi / 2]}
    (room / "room.yaml").write_text(yaml.safe_dump(quarter))
    scenario["agents"]["robot"]["state"] = [0.0, 2.6, 0.0]
    built = building()
    # A point of the map at (x, y) moves to (1 - y, 2 + x).
    assert depth(built, "free", (0.0, 2.6), (0.0, 3.3), (0.7, 2.3)) == pytest.approx([0.4, -0.1, -0.1])
    assert clearances(built, [(0.0, 3.0), (0.0, 4.7), (0.7, 4.7)]) == pytest.approx([0.2, 0.2, -0.1])


def test_thresholds_negation_and_modes_are_those_of_ros(
    building: Callable[..., Built], room: Path, scenario: dict[str, Any]
) -> None:
    def counts(**changes: Any) -> list[int]:
        (room / "room.yaml").write_text(yaml.safe_dump({**YAML, **changes}))
        cells = building().sections["map"].raster.cells
        return [int((cells == state).sum()) for state in (0, 1, 2)]

    assert counts() == [93, 46, 1]
    assert counts(free_thresh=0.19) == [93, 46, 1]
    assert counts(free_thresh=0.19, occupied_thresh=0.19) == [93, 47, 0]
    assert counts(negate=True) == [46, 94, 0]
    assert counts(mode="raw") == [46, 0, 94]
    assert counts(mode="scale") == [93, 46, 1]


def test_unknown_cells_are_bodies_if_the_scenario_says_so(
    building: Callable[..., Built], scenario: dict[str, Any]
) -> None:
    scenario["map"]["unknown"] = "solid"
    assert clearances(building(), [(0.3, 0.3)]) == pytest.approx([-0.1])


def test_a_log_runs_again_without_the_files_of_the_map(
    building: Callable[..., Built], room: Path, scenario: dict[str, Any]
) -> None:
    (room / "maps").mkdir()
    for name in ("room.yaml", "room.pgm"):
        shutil.move(room / name, room / "maps" / name)
    scenario["map"]["file"] = "maps/room.yaml"
    scenario["specifications"] = {"off": {"formula": 'always inside(position["robot"], free)'}}
    building()
    log = room / "first.mcap"
    sa.load(room / "scenario.yaml").run(output=log)
    shutil.rmtree(room / "maps")
    (room / "scenario.yaml").unlink()
    assert sa.verify_log(log).is_equal
    sa.load(log).run(output=room / "again.mcap")
    assert sa.verify_log(room / "again.mcap").is_equal


def test_a_map_may_come_from_the_folders_of_assets(
    building: Callable[..., Built], room: Path, scenario: dict[str, Any], tmp_path_factory: pytest.TempPathFactory
) -> None:
    shared = tmp_path_factory.mktemp("shared")
    for name in ("room.yaml", "room.pgm"):
        shutil.move(room / name, shared / name)
    scenario["assets"] = [str(shared)]
    assert sorted(building().section_files) == ["room.pgm", "room.yaml"]


@pytest.mark.parametrize(
    ("changes", "said", "path"),
    [
        ({"image": "nothing.pgm"}, "there is no file `nothing.pgm`", "image"),
        ({"image": "/etc/passwd"}, "has to be below the scenario's folder", "image"),
        ({"image": "../room.pgm"}, "has to be below the scenario's folder", "image"),
        ({"image": "x/../../room.pgm"}, "has to be below the scenario's folder", "image"),
        ({"image": "link.pgm"}, "leads out of the scenario's folder", "image"),
        ({"image": "room.yaml"}, "neither a .pgm nor a .png", "image"),
        ({"image": "cut.pgm"}, "ends after", "image"),
        ({"resolution": 0.0}, "`resolution` is 0", "resolution"),
        ({"resolution": float("nan")}, "not a finite number", "resolution"),
        ({"origin": [0.0, 0.0]}, "`origin`", "origin"),
        ({"negate": 2}, "`negate` is 2", "negate"),
        ({"free_thresh": 0.9}, "`free_thresh` is above `occupied_thresh`", ""),
        ({"occupied_thresh": 1.5}, "`occupied_thresh` is 1.5", "occupied_thresh"),
        ({"colour": "red"}, "unknown key `colour`", "colour"),
        ({"mode": "fancy"}, "`mode` is", "mode"),
    ],
)
def test_problems_of_a_map_are_located_in_the_file(
    changes: dict[str, Any],
    said: str,
    path: str,
    problems: Callable[..., list[Problem]],
    room: Path,
    scenario: dict[str, Any],
) -> None:
    (room / "cut.pgm").write_bytes(picture()[:-1])
    outside = room.parent / "outside.pgm"
    outside.write_bytes(picture())
    (room / "link.pgm").symlink_to(outside)
    (room / "room.yaml").write_text(yaml.safe_dump({**YAML, **changes}, sort_keys=False))
    scenario["specifications"] = {"off": {"formula": 'always inside(position["robot"], free)'}}
    (problem,) = problems()
    assert said in problem.message
    assert problem.path == path
    assert problem.span is not None
    assert problem.span.file.endswith("room.yaml")


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ({"file": "nothing.yaml"}, "there is no file `nothing.yaml`"),
        ({"file": "../room.yaml"}, "below the scenario's folder"),
        ({"file": "room.pgm"}, "its suffix is none of"),
        ({"file": "room.yaml", "height": 0}, "`map.height` is 0"),
    ],
)
def test_an_invalid_section_is_refused_at_its_place(
    written: dict[str, Any], said: str, problems: Callable[..., list[Problem]], scenario: dict[str, Any]
) -> None:
    scenario["map"] = written
    (problem,) = problems()
    assert said in problem.message
    assert problem.path.startswith("map.")


def test_a_map_of_too_many_bodies_is_refused(problems: Callable[..., list[Problem]], room: Path) -> None:
    board = (np.indices((150, 150)).sum(axis=0) % 2 * 255).astype(np.uint8)
    (room / "room.pgm").write_bytes(b"P5\n150 150\n255\n" + board.tobytes())
    (problem,) = problems()
    assert "make 11,250 rectangles, and a map may have 5,000" in problem.message
