"""The depths of points in regions: exact distances to the boundary, negative outside."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from symaware_cli.geometry.region import Region
from symaware_cli.geometry.vectors import relative

COORDINATE = st.floats(-5, 5, allow_nan=False)
POINTS = st.lists(st.tuples(COORDINATE, COORDINATE), min_size=1, max_size=5).map(np.array)
CORNERS = np.array([[0.0, 0.0], [4.0, 0.0], [5.0, 3.0], [1.0, 4.0]])


def region(**kinds: Any) -> Region:
    return Region.model_validate(kinds)


@pytest.mark.parametrize(
    ("kinds", "point", "depth"),
    [
        ({"box": [0, 4, 0, 2]}, [2, 1], 1),
        ({"box": [0, 4, 0, 2]}, [4, 1], 0),
        ({"box": [0, 4, 0, 2]}, [7, 6], -5),
        ({"box": [0, 4, 0, 2]}, [2, 3], -1),
        ({"box": [0, 4]}, [1], 1),
        ({"box": [0, 4, 0, 2, 0, 1]}, [2, 1, 0.75], 0.25),
        ({"circle": {"centre": [1, 1], "radius": 2}}, [1, 2], 1),
        ({"circle": {"centre": [1, 1], "radius": 2}}, [4, 5], -3),
        ({"circle": {"centre": [0, 0, 0], "radius": 3}}, [1, 2, 2], 0),
        ({"polygon": [[0, 0], [4, 0], [4, 4], [0, 4]]}, [1, 2], 1),
        ({"polygon": [[0, 0], [4, 0], [4, 4], [0, 4]]}, [7, 8], -5),
        ({"polygon": [[0, 4], [4, 4], [4, 0], [0, 0]]}, [1, 2], 1),
    ],
)
def test_depth_is_the_distance_to_the_boundary(kinds: dict[str, Any], point: list[float], depth: float) -> None:
    assert region(**kinds).depth(np.array([point], float))[0] == pytest.approx(depth)


@settings(deadline=None)
@given(POINTS)
def test_the_depth_in_a_polygon_is_the_distance_to_the_nearest_point_of_its_boundary(points: np.ndarray) -> None:
    samples = np.concatenate(
        [np.linspace(one, other, 2000) for one, other in zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True)]
    )
    found = region(polygon=CORNERS.tolist()).depth(points)
    for point, depth in zip(points, found, strict=True):
        assert abs(depth) == pytest.approx(np.linalg.norm(samples - point, axis=1).min(), abs=5e-3)
    # A box that is a polygon, too, has the same depths.
    box, square = region(box=[-1, 2, 0, 3]), region(polygon=[[-1, 0], [2, 0], [2, 3], [-1, 3]])
    np.testing.assert_allclose(box.depth(points), square.depth(points), atol=1e-12)


@given(POINTS)
def test_the_depth_of_a_point_does_not_depend_on_the_others(points: np.ndarray) -> None:
    for kinds in ({"box": [-1, 2, 0, 3]}, {"circle": {"centre": [1, 1], "radius": 2}}, {"polygon": CORNERS.tolist()}):
        whole = region(**kinds).depth(points)
        assert [region(**kinds).depth(point[None])[0] for point in points] == whole.tolist()


def test_points_are_seen_from_an_agent() -> None:
    points = np.array([[1.0, 2.0, 5.0]])
    np.testing.assert_allclose(relative(points, np.array([1.0, 1.0]), None), [[0, 1, 5]])
    np.testing.assert_allclose(relative(points, np.array([1.0, 1.0]), math.pi / 2), [[1, 0, 5]], atol=1e-15)


@pytest.mark.parametrize(
    ("kinds", "said"),
    [
        ({}, "exactly one kind"),
        ({"box": [0, 1, 0, 1], "circle": {"centre": [0, 0], "radius": 1}}, "this one has box and circle"),
        ({"box": [0, 1, 0]}, "2, 4 or 6 bounds are needed"),
        ({"box": [0, 1, 2, 2]}, "the least of coordinate 1 is not below its greatest"),
        ({"polygon": [[0, 0], [4, 0], [1, 1], [0, 4]]}, "not convex"),
        ({"circle": {"centre": [0], "radius": 1}}, "2 or 3 coordinates are needed"),
    ],
)
def test_an_invalid_region_is_refused(kinds: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        region(**kinds)


def test_a_regular_polygon_has_its_sides_at_the_apothem_one_of_them_in_the_direction_of_its_rotation() -> None:
    pentagon = region(polygon={"sides": 5, "centre": [1, 2], "apothem": 0.5, "rotation": 0.3})
    assert pentagon.polygon is not None
    assert len(pentagon.polygon) == 5
    middle = [1 + 0.5 * math.cos(0.3), 2 + 0.5 * math.sin(0.3)]
    assert pentagon.depth(np.array([[1.0, 2.0], middle])) == pytest.approx([0.5, 0.0], abs=1e-12)
    assert region(**pentagon.model_dump()) == pentagon


@pytest.mark.parametrize("wrong", [{"sides": 2}, {"apothem": 0}, {"corners": 3}, {"centre": [1]}, {"sides": "5"}])
def test_an_invalid_regular_polygon_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match="a regular polygon: `"):
        region(polygon={"sides": 5, "apothem": 0.3, **wrong})
