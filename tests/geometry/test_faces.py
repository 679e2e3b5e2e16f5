"""Faces of convex regions are half spaces: their intersection is the region, or a polytope within or around a ball."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.geometry.region import Region, ball_faces, region_faces
from symaware_cli.geometry.vectors import Array

COORDINATE = st.floats(-5, 5, allow_nan=False)
SHAPES = [
    Region(box=(-3, 2)),
    Region(box=(-3, 2, -1, 4)),
    Region(box=(-3, 2, -1, 4, 0, 1)),
    Region(polygon=((0, 0), (4, 0), (5, 3), (1, 4))),
]


def points(dimensions: int) -> st.SearchStrategy[Array]:
    return st.lists(COORDINATE, min_size=dimensions, max_size=dimensions).map(np.array)


@pytest.mark.parametrize("shape", SHAPES, ids=["interval", "rectangle", "cuboid", "quadrilateral"])
@given(data=st.data())
def test_the_nearest_face_is_as_far_as_the_boundary_for_points_within(shape: Region, data: st.DataObject) -> None:
    point = data.draw(points(shape.dimensions))
    faces = region_faces(shape)
    nearest = (faces.normals @ point + faces.offsets).min()
    depth = shape.depth(point[None])[0]
    assert np.sign(np.round(nearest, 9)) == np.sign(np.round(depth, 9))
    if depth >= 0:
        assert nearest == pytest.approx(depth, abs=1e-12)


@pytest.mark.parametrize("dimensions", [1, 2, 3])
@given(data=st.data())
def test_one_polytope_lies_within_the_ball_and_the_other_contains_it(dimensions: int, data: st.DataObject) -> None:
    point = data.draw(points(dimensions))
    distance = np.sqrt((point * point).sum())
    within, around = ball_faces(dimensions, 2.0), ball_faces(dimensions, 2.0, around=True)
    if (within.normals @ point + within.offsets >= 0).all():
        assert distance <= 2.0 + 1e-12
    if distance <= 2.0:
        assert (around.normals @ point + around.offsets >= -1e-12).all()
