"""Routes go around obstacles, the shortest way, and keep their distance."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

pytest.importorskip("casadi", reason="CasADi is an extra")

from symaware_cli import Obstacle, Scenery
from symaware_cli.planning.control.mpc_reference import Routes

BOX = {"shape": {"box": {"length": 2.0, "width": 4.0}}, "position": [0.0, 0.0]}
KEEP = 0.5


def scenery(*obstacles: Mapping[str, Any]) -> Scenery:
    return Scenery({f"thing-{n}": Obstacle.model_validate(each) for n, each in enumerate(obstacles)})


def way(origin: ArrayLike, target: ArrayLike, *obstacles: Mapping[str, Any], keep: float = KEEP) -> NDArray[np.float64]:
    """The whole way, from the origin to the target; shape (c, 2)."""
    around = Routes(scenery(*obstacles).pieces, keep).to(np.array(target)).by_way_of(np.array(origin))
    return np.concatenate([[origin], around, [target]])


def length(corners: NDArray[np.float64]) -> float:
    return float(np.hypot(*np.diff(corners, axis=0).T).sum())


def test_the_way_is_straight_where_nothing_is_in_between() -> None:
    assert way([-3.0, 0.0], [3.0, 0.0]).tolist() == [[-3, 0], [3, 0]]
    assert way([-3.0, 3.0], [3.0, 3.0], BOX).tolist() == [[-3, 3], [3, 3]]


def test_the_way_around_a_box_passes_its_nearer_corners() -> None:
    corners = way([-3.0, 0.1], [3.0, 0.1], BOX)
    reach = 1.05 * KEEP
    assert corners[1:-1] == pytest.approx(np.array([[-1 - reach, 2 + reach], [1 + reach, 2 + reach]]))
    assert way([-3.0, -0.1], [3.0, -0.1], BOX)[1:-1, 1] == pytest.approx(-2 - reach)


def test_a_disc_is_passed_on_a_polygon_around_it() -> None:
    disc = {"shape": {"circle": {"radius": 1.0}}, "position": [0.0, 0.0]}
    corners = way([-4.0, 0.2], [4.0, 0.2], disc)
    # The shortest way along a circle of this radius: two tangents, and an arc.
    radius, distance = 1.5, np.hypot(4.0, 0.2)
    tangent, angle = np.sqrt(distance**2 - radius**2), np.arccos(radius / distance)
    shortest = 2 * tangent + radius * (np.pi - 2 * np.arctan2(0.2, 4.0) - 2 * angle)
    assert shortest < length(corners) < 1.04 * shortest
    assert (corners[1:-1, 1] > 1.0).all()


@pytest.mark.parametrize(("gap", "through"), [(1.2, True), (0.8, False)])
def test_only_gaps_that_are_wide_enough_are_gone_through(gap: float, through: bool) -> None:
    walls = [
        {"shape": {"wall": {"points": [[0.0, sign * (gap + 0.1) / 2], [0.0, sign * 6.0]], "thickness": 0.1}}}
        for sign in (1.0, -1.0)
    ]
    corners = way([-3.0, 0.2], [3.0, 0.2], *walls)
    assert bool(np.abs(corners[:, 1]).max() < 1.0) is through


def test_a_maze_is_left_by_its_only_way() -> None:
    maze = {"shape": {"wall": {"points": [[-2, 2], [2, 2], [2, -2], [-2, -2], [-2, 0.9]], "thickness": 0.1}}}
    # Its opening is at the upper left, 1.05 m wide.
    corners = way([0.0, 0.0], [5.0, 0.0], maze, keep=0.4)
    outside = np.abs(corners).max(axis=1) > 2.0
    assert corners[np.argmax(outside), 0] < -2.0
    assert length(corners) > 10.0


def test_where_there_is_no_way_none_is_given() -> None:
    closed = {"shape": {"wall": {"points": [[-2, 2], [2, 2], [2, -2], [-2, -2], [-2, 2]], "thickness": 0.1}}}
    assert len(way([0.0, 0.0], [5.0, 0.0], closed)) == 2
    assert len(way([0.0, 0.0], [5.0, 0.0], BOX)) == 2  # from inside


def test_nothing_is_planned_among_too_many_pieces() -> None:
    many = [{**BOX, "position": [0.0, 5.0 * n]} for n in range(51)]
    assert len(way([-3.0, 0.1], [3.0, 0.1], *many)) == 2
    assert len(way([-3.0, 0.1], [3.0, 0.1], *many[:50])) == 4


SHAPES = st.one_of(
    st.floats(0.2, 1.0).map(lambda radius: {"circle": {"radius": radius}}),
    st.tuples(st.floats(0.3, 2.0), st.floats(0.3, 2.0)).map(lambda e: {"box": {"length": e[0], "width": e[1]}}),
    st.floats(0.3, 2.0).map(lambda e: {"polygon": {"vertices": [[0, 0], [e, 0.1 * e], [0, 0.3 * e]]}}),
    st.floats(0.3, 2.0).map(lambda e: {"wall": {"points": [[-e, 0], [e, 0], [e, e]], "thickness": 0.2}}),
)
THINGS = st.builds(
    lambda shape, place, heading: {"shape": shape, "position": list(place), "heading": heading},
    SHAPES,
    st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)),
    st.floats(-3.0, 3.0),
)


@given(st.lists(THINGS, max_size=5))
@settings(max_examples=40)
def test_an_agent_on_a_route_keeps_its_distance(things: list[dict[str, Any]]) -> None:
    origin, target = np.array([-6.0, 0.3]), np.array([6.0, -0.2])
    corners = way(origin, target, *things)
    whole = scenery(*things)
    points = np.concatenate([a + np.linspace(0, 1, 200)[:, None] * (b - a) for a, b in pairwise(corners)])
    if len(corners) > 2 or not whole.blocks(origin[None], target[None])[0]:
        nearest = whole.nearest(points, 0.9 * KEEP).distance
        if len(corners) > 2:
            assert nearest.min(initial=np.inf) > 0.9 * KEEP - 1e-6
    else:
        # No way can only be where obstacles close a ring, which a few of these cannot around the ends.
        assert len(things) >= 2
    assert length(corners) >= np.hypot(*(target - origin)) - 1e-12
