"""Convexity of meshes, checked for each part of a file."""

import numpy as np
import pytest

from symaware_cli.assets.convexity import is_convex
from symaware_cli.assets.mesh_file import MeshSurface, parse_mesh
from symaware_cli.geometry import Array

CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
#: Two triangles for each face of a cube, the bottom first and the top last.
FACES = [[0, 2, 6], [0, 6, 4], [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]]
LID = [[1, 5, 7], [1, 7, 3]]


def surface(*parts: tuple[Array, list[list[int]]]) -> MeshSurface:
    corners, start = [], 0
    for vertices, faces in parts:
        corners.append(np.array(faces) + start)
        start += len(vertices)
    vertices = np.concatenate([vertices for vertices, _ in parts])
    return MeshSurface(vertices, np.concatenate(corners), tuple(len(faces) for _, faces in parts))


def sphere(rings: int) -> Array:
    angles = np.linspace(0.0, np.pi, rings)
    around = np.linspace(0.0, 2.0 * np.pi, 2 * rings)
    theta, phi = np.meshgrid(angles, around, indexing="ij")
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def grid(points: Array) -> MeshSurface:
    """The surface of a grid of points; shape (n, m, 3)."""
    n, m, _ = points.shape
    quads = [
        (i * m + j, i * m + j + 1, (i + 1) * m + j + 1, (i + 1) * m + j) for i in range(n - 1) for j in range(m - 1)
    ]
    faces = [list(triangle) for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return surface((points.reshape(-1, 3), faces))


def test_a_cube_and_a_sphere_are_convex() -> None:
    assert is_convex(surface((CORNERS, FACES + LID)))
    assert is_convex(grid(sphere(20)))


def test_a_sphere_with_a_dent_is_not() -> None:
    dented = sphere(20)
    dented[..., 0] = np.minimum(dented[..., 0], 0.9 - 0.5 * (dented[..., 0] > 0.9))
    assert not is_convex(grid(dented))


def test_a_cube_without_a_lid_is_not() -> None:
    assert not is_convex(surface((CORNERS, FACES)))


def test_two_cubes_are_convex_as_two_parts_and_not_as_one() -> None:
    cube = FACES + LID
    two = surface((CORNERS, cube), (CORNERS + np.array([3.0, 0.0, 0.0]), cube))
    assert is_convex(two)
    assert not is_convex(MeshSurface(two.vertices, two.corners, (len(two.corners),)))


def test_a_flat_part_counts_as_convex() -> None:
    flat = parse_mesh(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", ".obj")
    assert is_convex(flat)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_size_does_not_matter(scale: float) -> None:
    assert is_convex(surface((scale * CORNERS, FACES + LID)))
    assert not is_convex(surface((scale * CORNERS, FACES)))
