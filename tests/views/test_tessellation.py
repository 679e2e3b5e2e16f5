"""Solids as triangles."""

import numpy as np
import pytest

from symaware_cli.geometry.articulation import Visual
from symaware_cli.views.tessellation import tessellated

SOLIDS = [
    (Visual(kind="box", size=(1.0, 2.0, 3.0)), 6.0),
    (Visual(kind="prism", size=(2.0,), outline=((0, 0), (3, 0), (0, 1))), 3.0),
    (Visual(kind="sphere", size=(2.0,)), 4 / 3 * np.pi * 8),
    (Visual(kind="cylinder", size=(1.0, 3.0)), 3 * np.pi),
    (Visual(kind="capsule", size=(1.0, 3.0)), (3 + 4 / 3) * np.pi),
]


@pytest.mark.parametrize(("visual", "volume"), SOLIDS, ids=lambda value: getattr(value, "kind", ""))
def test_the_surface_is_closed_and_encloses_the_volume_of_the_solid(visual: Visual, volume: float) -> None:
    vertices, _, corners = tessellated(visual)
    first, second, third = (vertices[corners[:, place]] for place in range(3))
    # The divergence theorem; triangles that run the wrong way round would count negative.
    assert np.einsum("ij,ij->", first, np.cross(second, third)) / 6 == pytest.approx(volume, rel=0.02)
    assert np.abs(np.cross(second - first, third - first).sum(axis=0)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("visual", "volume"), SOLIDS, ids=lambda value: getattr(value, "kind", ""))
def test_normals_point_outwards(visual: Visual, volume: float) -> None:
    vertices, normals, corners = tessellated(visual)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    first, second, third = (vertices[corners[:, place]] for place in range(3))
    facing = np.cross(second - first, third - first)
    sound = np.linalg.norm(facing, axis=1) > 1e-9  # at the poles of a ball triangles have no area
    assert (np.einsum("ij,ij->i", facing, normals[corners].mean(axis=1))[sound] > 0).all()


@pytest.mark.parametrize(
    ("visual", "half"), [(SOLIDS[2][0], [2, 2, 2]), (SOLIDS[3][0], [1, 1, 1.5]), (SOLIDS[4][0], [1, 1, 2.5])]
)
def test_round_solids_reach_as_far_as_they_say(visual: Visual, half: list[float]) -> None:
    vertices = tessellated(visual).vertices
    np.testing.assert_allclose(
        [vertices.min(axis=0), vertices.max(axis=0)], [[-each for each in half], half], atol=1e-2
    )
