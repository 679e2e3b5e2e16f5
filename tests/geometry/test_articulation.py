"""Trees of links, and rotations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from symaware_cli.geometry.articulation import Articulation, Link, Visual
from symaware_cli.geometry.rotation import about, attitude, composed, rotated

ANGLE = st.floats(-3.0, 3.0)
TRIPLE = st.tuples(ANGLE, ANGLE, ANGLE)


def same_rotation(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    return bool(np.abs(np.sum(np.asarray(one) * other, axis=-1)) == pytest.approx(1.0, abs=1e-12))


@given(TRIPLE, TRIPLE, TRIPLE)
def test_rotations_compose_and_turn_vectors_as_those_of_scipy(
    first: tuple[float, float, float], second: tuple[float, float, float], vector: tuple[float, float, float]
) -> None:
    one, other = Rotation.from_euler("xyz", first), Rotation.from_euler("xyz", second)
    assert same_rotation(attitude(*first), one.as_quat())
    assert same_rotation(composed(attitude(*first), attitude(*second)), (one * other).as_quat())
    assert rotated(attitude(*first), vector) == pytest.approx(one.apply(vector), abs=1e-12)


def test_many_rotations_are_made_at_once() -> None:
    turned = rotated(about((0, 0, 1), np.array([0.0, np.pi / 2])), np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(turned, [[1, 0, 0], [0, 1, 0]], atol=1e-15)


#: A crane: a mast that turns, a boom that slides out of it.
CRANE = Articulation(
    name="crane",
    links=(
        Link(name="foot"),
        Link(name="mast", parent=0, position=(0, 0, 2), joint="slew", motion="turn", axis=(0, 0, 1)),
        Link(name="boom", parent=1, position=(1, 0, 0), joint="reach", motion="slide", axis=(1, 0, 0)),
    ),
)


def test_links_are_where_their_joints_put_them() -> None:
    assert CRANE.joints == {"slew": "rad", "reach": "m"}
    positions, orientations = CRANE.frames([[0.0, 0.0], [np.pi / 2, 0.5]])
    np.testing.assert_allclose(positions[:, 2], np.array([[1, 0, 2], [0, 1.5, 2]]), atol=1e-15)
    assert same_rotation(orientations[1, 2], about((0, 0, 1), np.pi / 2))


def test_without_positions_all_joints_are_at_zero() -> None:
    assert CRANE.frames()[0].tolist() == [[0, 0, 0], [0, 0, 2], [1, 0, 2]]


@pytest.mark.parametrize("parents", [(0,), (-1, 1), (-1, -1), (-1, 2, 0)])
def test_links_that_form_no_tree_are_refused(parents: tuple[int, ...]) -> None:
    with pytest.raises(ValidationError, match="comes after its parent"):
        Articulation(name="a", links=[Link(name="b", parent=parent) for parent in parents])


@pytest.mark.parametrize(
    "visual",
    [{"kind": "box", "size": (1.0,)}, {"kind": "mesh", "size": (1, 1, 1)}, {"kind": "prism", "size": (1.0,)}],
)
def test_visual_shapes_without_a_size_are_refused(visual: dict[str, str | tuple[float, ...]]) -> None:
    with pytest.raises(ValidationError):
        Visual(**visual)
