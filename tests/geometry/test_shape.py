"""Shapes: their kinds, and refusals of invalid ones."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from symaware_cli import Box, Circle, Polygon, Shape, Wall

SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


@pytest.mark.parametrize(
    ("shape", "kind", "radius"),
    [
        (Shape(circle=Circle(radius=2.0)), "circle", 2.0),
        (Shape(box=Box(length=8.0, width=6.0)), "box", 5.0),
        (Shape(polygon=Polygon(vertices=[(3, 4), (0, 1), (0, 0)])), "polygon", 5.0),
        (Shape(wall=Wall(points=[(0, 0), (3, 4), (1, 1)], thickness=0.5)), "wall", 5.25),
    ],
)
def test_a_shape_is_of_one_kind_and_fits_into_its_radius(shape: Shape, kind: str, radius: float) -> None:
    assert shape.kind == kind
    assert shape.radius == pytest.approx(radius)
    assert list(shape.model_dump(mode="json")) == [kind], "other kinds are not mentioned"
    assert Shape.model_validate_json(shape.model_dump_json(), strict=True) == shape


def test_a_shape_has_exactly_one_kind() -> None:
    with pytest.raises(ValidationError, match="this one has none"):
        Shape()
    with pytest.raises(ValidationError, match="this one has circle and box"):
        Shape(circle=Circle(radius=1.0), box=Box(length=1.0, width=1.0))


@pytest.mark.parametrize("start", range(4))
@pytest.mark.parametrize("order", [1, -1])
def test_a_polygon_runs_counter_clockwise_however_it_was_written(start: int, order: int) -> None:
    written = (SQUARE[start:] + SQUARE[:start])[::order]
    x, y = np.array(Polygon(vertices=written).vertices).T
    assert np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) == 2.0, "twice its area"


def test_corners_along_a_side_make_a_polygon_no_less_convex() -> None:
    assert len(Polygon(vertices=[(0, 0), (0.5, 0), (1, 0), (1, 1)]).vertices) == 4


STAR = [(math.cos(angle), math.sin(angle)) for angle in np.arange(5) * 4 * math.pi / 5]
BACK_AND_FORTH = [(0, 0), (2, 0), (1, 0), (1, 1)]


@pytest.mark.parametrize(
    ("vertices", "said"),
    [
        (SQUARE[:2], "at least 3 corners, not 2"),
        ([(0, 0), (1, 1), (2, 2)], "lie on a line"),
        ([(0, 0), (1, 1e-12), (2, 0)], "lie on a line"),
        ([*SQUARE, SQUARE[0]], "corners 4 and 0 are the same point"),
        ([(0, 0), (0, 0), (1, 0), (0, 1)], "corners 0 and 1 are the same point"),
        ([(0, 0), (1, 0), (0.1, 0.1), (0, 1)], "not convex"),
        (STAR, "not convex"),
        (STAR[::-1], "not convex"),
        (SQUARE[:1] + SQUARE[2:] + SQUARE[1:2], "not convex"),
        (BACK_AND_FORTH, "not convex"),
        ([(0, 0), (1,), (0, 1)], "2 coordinates are needed, not 1"),
        ([(0, 0), (math.inf, 0), (0, 1)], "finite"),
        ([(0, 0), (1e12, 0), (0, 1)], "less than or equal"),
    ],
)
def test_an_invalid_polygon_is_refused(vertices: list[tuple[float, ...]], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        Polygon(vertices=vertices)


@given(st.integers(3, 40), st.floats(0, 7), st.floats(1e-3, 1e3), st.floats(0.01, 1), st.floats(-1e3, 1e3))
def test_corners_in_order_on_an_ellipse_are_a_polygon(
    count: int, start: float, size: float, flat: float, offset: float
) -> None:
    angles = start + np.arange(count) * 2 * np.pi / count
    corners = [(offset + size * math.cos(angle), flat * size * math.sin(angle)) for angle in angles]
    assert len(Polygon(vertices=corners).vertices) == count


def test_a_wall_needs_distinct_points() -> None:
    with pytest.raises(ValidationError, match="points 1 and 2 are the same"):
        Wall(points=[(0, 0), (1, 0), (1, 0)])
    with pytest.raises(ValidationError, match="at least 2 points, not 1"):
        Wall(points=[(0, 0)])
