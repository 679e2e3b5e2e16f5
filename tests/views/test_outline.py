"""Outlines of shapes."""

import numpy as np
import pytest
import shapely

from symaware_cli import Box, Circle, Polygon, Shape, Wall
from symaware_cli.views.outline import circle, outlines, placed, prism_surface

SHAPES = [
    (Shape(circle=Circle(radius=0.5)), 0.25 * np.pi),
    (Shape(box=Box(length=2.0, width=1.0)), 2.0),
    (Shape(polygon=Polygon(vertices=[(0, 0), (2, 0), (0, 1)])), 1.0),
    (Shape(wall=Wall(points=[(0, 0), (3, 0)], thickness=0.2)), 0.6 + 0.01 * np.pi),
]


@pytest.mark.parametrize(("shape", "area"), SHAPES)
def test_an_outline_has_the_area_of_its_shape_and_runs_counter_clockwise(shape: Shape, area: float) -> None:
    (outline,) = outlines(shape.pieces)
    ring = shapely.LinearRing(outline)
    assert ring.is_ccw
    assert shapely.Polygon(outline).area == pytest.approx(area, rel=0.01)


def test_a_wall_of_two_segments_has_two_pieces() -> None:
    assert len(outlines(Shape(wall=Wall(points=[(0, 0), (1, 0), (1, 1)])).pieces)) == 2


def test_a_circle_is_closed() -> None:
    ring = circle(2.0, corners=8)
    np.testing.assert_allclose(ring[0], ring[-1], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), 2.0)


def test_an_outline_turns_with_the_heading_and_moves_with_the_position() -> None:
    corners = placed(np.array([[1.0, 0.0]]), np.array([[5.0, 6.0, 7.0]]), np.array([0.5 * np.pi]))
    np.testing.assert_allclose(corners, [[[5.0, 7.0, 7.0]]])


@pytest.mark.parametrize(("shape", "area"), SHAPES)
def test_a_prism_is_closed_and_has_the_volume_of_its_outline_times_its_height(shape: Shape, area: float) -> None:
    (outline,) = outlines(shape.pieces)
    vertices, triangles = prism_surface(outline, 1.0, 4.0)
    one, two, three = vertices[triangles].swapaxes(0, 1)
    # The divergence theorem: with all triangles facing outwards the signed volumes add up.
    volume = np.einsum("ij,ij->i", one, np.cross(two, three)).sum() / 6.0
    assert abs(volume) == pytest.approx(3.0 * shapely.Polygon(outline).area)
    edges = {tuple(edge) for triangle in triangles for edge in zip(triangle, np.roll(triangle, -1), strict=True)}
    assert {(b, a) for a, b in edges} == edges


def test_a_prism_without_height_is_one_face() -> None:
    vertices, triangles = prism_surface(circle(1.0, corners=6)[:-1], 0.5, 0.5)
    assert (len(vertices), len(triangles)) == (6, 4)
    assert (vertices[:, 2] == 0.5).all()
