"""Polygons as well-known text and as GeoJSON: their bodies and regions, and the places of problems."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from symaware_cli.geometry.shape import Polygon
from symaware_cli.language.build import Built
from symaware_cli.language.problem import Problem, ScenarioError
from symaware_cli.maps.convex import convex_pieces
from symaware_cli.maps.polygon_file import PolygonFile

#: An L, and a ring around a hole.
ELL = [[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3], [0, 0]]
FRAME = [
    [[10, 10], [14, 10], [14, 14], [10, 14], [10, 10]],
    [[11, 11], [11, 13], [13, 13], [13, 11], [11, 11]],
]


def text(ring: Any) -> str:
    return "(" + ", ".join(f"{x} {y}" for x, y in ring) + ")"


WKT = f"POLYGON ({text(ELL)})\nMULTIPOLYGON (({', '.join(map(text, FRAME))}));\n"
GEOJSON = {
    "type": "FeatureCollection",
    "features": [
        {"type": "Feature", "properties": {"name": "L"}, "geometry": {"type": "Polygon", "coordinates": [ELL]}},
        {"type": "GeometryCollection", "geometries": [{"type": "MultiPolygon", "coordinates": [FRAME]}]},
    ],
}


@pytest.mark.parametrize(("name", "content"), [("a.wkt", WKT), ("a.geojson", json.dumps(GEOJSON, indent="\t"))])
def test_both_formats_give_the_same_polygons(name: str, content: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    found = PolygonFile(tmp_path / name).polygons
    assert [[ring.corners.tolist() for ring in rings] for rings in found] == [[ELL], FRAME]


@pytest.mark.parametrize(
    ("content", "said", "place"),
    [
        ("POLYGON ((0 0, 0 1, 1 1, 0 0))", "an outer ring runs counter-clockwise, this one clockwise", (1, 11)),
        ("POLYGON ((0 0, 9 0, 9 9, 0 9, 0 0),\n (1 1, 2 1, 2 2, 1 1))", "a hole runs clockwise", (2, 3)),
        ("POLYGON ((0 0, 2 2, 2 0, 0 3, 0 0))", "invalid: self-intersection at (", (1, 11)),
        ("POLYGON ((0 0, 4 0, 4 4, 0 0), (8 8, 8 9, 9 9, 8 8))", "hole lies outside shell", (1, 11)),
        ("POLYGON ((0 0, 1 0, 1 1))", "at least 4 positions", (1, 11)),
        ("POLYGON ((0 0, 1 0, 1 1, 0 1))", "the ring is not closed", (1, 26)),
        ("POLYGON ((0 0, 1 0,\n 1 0, 1 1, 0 0))", "that of the corner before it", (2, 2)),
        ("POLYGON ((0 0, 1 0, nan 1, 0 0))", "a position is two numbers", (1, 21)),
        ("POLYGON ((0 0, 1 0, 1e400 1, 0 0))", "not a number from -1e+09 to 1e+09", (1, 21)),
        ("POLYGON ((0 0 0, 1 0 0, 1 1 0, 0 0 0))", "a position is two numbers", (1, 11)),
        ("POLYGON Z ((0 0 0, 1 0 0, 1 1 0, 0 0 0))", "there should be `(` here, not `Z`", (1, 9)),
        ("POLYGON ((0 0, 1 0, 1 1, 0 0)", "there should be `)` here, not the end of the file", (1, 29)),
        ("LINESTRING (0 0, 1 1)", "`LINESTRING` is none of", (1, 1)),
        ("POLYGON EMPTY", "the file has no polygons", (1, 1)),
        ("GEOMETRYCOLLECTION (" * 20 + "POLYGON EMPTY" + ")" * 20, "is none of", (1, 181)),
        ("", "the file has no polygons", (1, 1)),
    ],
)
def test_well_known_text_that_is_wrong_is_refused_with_its_place(
    content: str, said: str, place: tuple[int, int], tmp_path: Path
) -> None:
    path = tmp_path / "walls.wkt"
    path.write_text(content)
    with pytest.raises(ScenarioError) as caught:
        PolygonFile(path)
    (problem,) = caught.value.problems
    assert said in problem.message
    assert problem.span is not None
    assert (problem.span.line, problem.span.column) == place


@pytest.mark.parametrize(
    ("content", "said", "place"),
    [
        ('{"type": "Polygon",\n "coordinates": [[[0, 0], [0, 1], [1, 1], [0, 0]]]}', "counter-clockwise", (2, 19)),
        ('{"type": "Polygon",\n "coordinates": [[[0, 0], [2, 2], [2, 0], [0, 3], [0, 0]]]}', "self-inter", (2, 19)),
        ('{"type": "Polygon",\n "coordinates": [[[0, 0], [1, NaN], [1, 1], [0, 0]]]}', "two numbers", (2, 27)),
        ('{"type": "Polygon",\n "coordinates": [[[0, 0], [1, true], [1, 1], [0, 0]]]}', "two numbers", (2, 27)),
        ('{"type": "Polygon",\n "coordinates": [[[0, 0], [1], [1, 1], [0, 0]]]}', "two numbers", (2, 27)),
        ('{"type": "Polygon",\n "coordinates": []}', "a list with something in it", (2, 17)),
        ('{"type": "Polygon"}', "a Polygon has `coordinates`", (1, 1)),
        ('{"type": "Point", "coordinates": [0, 0]}', "a `Point` is none of", (1, 10)),
        ('{"a": 1}', "an object without a type", (1, 1)),
        ("[1, 2]", "a GeoJSON object is a mapping", (1, 1)),
        ('{"type": "Feature", "geometry": null}', "a GeoJSON object is a mapping", (1, 33)),
        ('{"type": ', "", None),
        ("[" * 100, "", None),
        ("", "", None),
    ],
)
def test_geojson_that_is_wrong_is_refused_with_its_place(
    content: str, said: str, place: tuple[int, int] | None, tmp_path: Path
) -> None:
    path = tmp_path / "walls.geojson"
    path.write_text(content)
    with pytest.raises(ScenarioError) as caught:
        PolygonFile(path)
    problem = caught.value.problems[0]
    assert said in problem.message
    if place is not None:
        assert problem.span is not None
        assert (problem.span.line, problem.span.column) == place


def test_a_file_of_too_many_corners_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "walls.wkt"
    square = "POLYGON ((0 0, 1 0, 1 1, 0 1, 0 0))\n"
    path.write_text(square * 4001)
    with pytest.raises(ScenarioError, match="more than 20,000 corners"):
        PolygonFile(path)


@pytest.mark.parametrize("seed", range(30))
def test_convex_pieces_cover_a_polygon_and_do_not_overlap(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(3, 25))
    angles = np.sort(random.uniform(0.0, 2 * np.pi, count))
    if np.diff(angles, append=angles[0] + 2 * np.pi).max() > 3.0:
        angles = 2 * np.pi * np.arange(count) / count
    radii = random.uniform(1.0, 5.0, count)
    ring = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)
    hole = 0.3 * np.array([[1, 0], [0, -1], [-1, 0], [0, 1]]) + 0.01 * random.normal(size=2)
    rings = [np.concatenate([ring, ring[:1]])]
    whole = shapely.Polygon(ring)
    if seed % 2 and whole.contains(shapely.Polygon(hole)):
        rings.append(np.concatenate([hole, hole[:1]]))
        whole = whole.difference(shapely.Polygon(hole))
    pieces = convex_pieces(rings)
    for corners in pieces:
        Polygon(vertices=tuple(map(tuple, corners.tolist())))  # convex, and without repeated corners
    assert sum(shapely.Polygon(each).area for each in pieces) == pytest.approx(whole.area)
    assert shapely.unary_union([shapely.Polygon(each) for each in pieces]).symmetric_difference(
        whole
    ).area == pytest.approx(0.0, abs=1e-9)
    assert len(pieces) <= count + 4, "fewer than the triangles"


def test_walls_from_polygons_are_bodies_and_regions(
    building: Callable[..., Built], room: Path, scenario: dict[str, Any]
) -> None:
    (room / "walls.wkt").write_text(WKT)
    scenario["map"] = {"file": "walls.wkt"}
    scenario["agents"]["robot"]["state"] = [3.0, 2.0, 0.0]
    built = building()
    assert 6 <= len(built.simulation.environment.obstacles) <= 7
    assert list(built.files) == ["scenario.yaml", "walls.wkt"]
    scenery = built.simulation.environment.scenery
    assert not len(scenery.nearest(np.array([[12.0, 12.0]]), 0.9).row), "the hole is free"
    assert scenery.nearest(np.array([[0.5, 2.0], [10.5, 12.0]]), 0.1).distance.max() < 0.0


def test_a_wrong_polygon_is_a_problem_of_the_scenario(
    problems: Callable[..., list[Problem]], room: Path, scenario: dict[str, Any]
) -> None:
    (room / "walls.wkt").write_text("POLYGON ((0 0, 0 1, 1 1, 0 0))\nPOLYGON ((0 0, 1 0, 1 1))")
    scenario["map"] = {"file": "walls.wkt"}
    found = problems()
    assert [problem.span and problem.span.line for problem in found] == [1, 2]
