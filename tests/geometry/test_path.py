"""The positions of bodies that move along paths."""

from typing import Any

import pytest
from pydantic import ValidationError

from symaware_cli import Circle, Obstacle, ScriptedPath, Shape

DISC = Shape(circle=Circle(radius=1.0))

PATH = {"times": (1.0, 2.0, 4.0), "positions": ((0, 0), (2, 0), (2, 6)), "headings": (0.0, 1.0, -1.0)}


@pytest.mark.parametrize(
    ("time", "position", "heading", "velocity", "turn_rate"),
    [
        (0.0, (0, 0), 0.0, (0, 0), 0.0),
        (1.0, (0, 0), 0.0, (2, 0), 1.0),
        (1.5, (1, 0), 0.5, (2, 0), 1.0),
        (2.0, (2, 0), 1.0, (0, 3), -1.0),
        (3.0, (2, 3), 0.0, (0, 3), -1.0),
        (4.0, (2, 6), -1.0, (0, 0), 0.0),
        (9.0, (2, 6), -1.0, (0, 0), 0.0),
    ],
)
def test_a_body_on_a_path_moves_straight_between_positions_and_rests_before_and_after(
    time: float, position: tuple[int, int], heading: float, velocity: tuple[int, int], turn_rate: float
) -> None:
    assert Obstacle(shape=DISC, path=ScriptedPath(**PATH)).pose(time) == (position, heading, velocity, turn_rate)


@pytest.mark.parametrize("turns", [0, 1, 7])
@pytest.mark.parametrize("time", [1.0, 1.5, 2.0, 3.5])
def test_a_repeated_path_restarts_at_the_last_time(turns: int, time: float) -> None:
    path, once = ScriptedPath(**PATH, repeat=True), ScriptedPath(**PATH)
    assert path.pose(time + 3.0 * turns) == once.pose(time)
    assert path.pose(0.5) == once.pose(0.5), "it rests before the first time"


def test_the_mean_velocity_leads_to_the_next_position_of_the_path() -> None:
    path = ScriptedPath(**PATH)
    assert path.course(1.5, 0.5) == path.pose(1.5)
    # A turn at half of the span: 1 m along x and 1.5 m along y.
    assert path.course(1.5, 1.0) == ((1, 0), 0.5, (1, 1.5), 0.0)


@pytest.mark.parametrize("early", [0.25, 1e-9])
def test_a_jump_is_no_motion(early: float) -> None:
    jumping = ScriptedPath(**PATH, repeat=True)
    assert jumping.course(4.0 - early, 0.5) == jumping.pose(4.0 - early)
    assert jumping.course(7.0 - early, 0.5) == jumping.pose(7.0 - early)
    assert jumping.course(4.0, 0.5) == jumping.pose(1.0)
    turning = ScriptedPath(times=(0, 1), positions=((0, 0), (0, 0)), headings=(0.0, 6.0), repeat=True)
    assert turning.course(1.0 - early, 0.5).turn_rate == 6.0


def test_a_closed_path_continues_without_a_jump() -> None:
    path = ScriptedPath(times=(0, 1, 2), positions=((0, 0), (1, 0), (0, 0)), repeat=True)
    assert path.course(1.75, 0.5) == ((0.25, 0), 0.0, (0, 0), 0.0)


def test_without_headings_a_body_keeps_its_heading() -> None:
    path = ScriptedPath(times=(0, 1), positions=((0, 0), (1, 0)))
    assert [Obstacle(shape=DISC, heading=0.7, path=path).pose(time).heading for time in (-1, 0.5, 2)] == [0.7] * 3


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"times": (0.0, 2.0, 2.0)}, "do not ascend: 2 s follows 2 s"),
        ({"times": (0.0, 2.0)}, "3 positions for 2 times"),
        ({"times": (0.0,)}, "at least 2 times, not 1"),
        ({"headings": (0.0,)}, "1 headings for 3 times"),
        ({"positions": ((0, 0), (1, 1), (1, 1, 1))}, "some positions have 2 coordinates, others 3"),
        ({"positions": ((0, 0), (1, 1), (1,))}, "2 or 3 coordinates are needed, not 1"),
    ],
)
def test_a_path_that_does_not_fit_together_is_refused(change: dict[str, tuple[Any, ...]], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        ScriptedPath(**{**PATH, **change})
