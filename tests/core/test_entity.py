"""Shapes, where obstacles are, and what is said of those that cannot be."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from symaware_cli import Box, Circle, Entity, Obstacle, Polygon, ScriptedPath, Shape, Wall
from symaware_cli.scenario.build import build
from symaware_cli.scenario.problem import ScenarioError

SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
DISC = Shape(circle=Circle(radius=1.0))


@pytest.mark.parametrize(
    ("shape", "kind", "radius"),
    [
        (Shape(circle=Circle(radius=2.0)), "circle", 2.0),
        (Shape(box=Box(length=8.0, width=6.0)), "box", 5.0),
        (Shape(polygon=Polygon(vertices=[(3, 4), (0, 1), (0, 0)])), "polygon", 5.0),
        (Shape(wall=Wall(points=[(0, 0), (3, 4), (1, 1)], thickness=0.5)), "wall", 5.25),
    ],
)
def test_a_shape_is_of_one_kind_and_fits_into_its_radius(shape, kind, radius):
    assert shape.kind == kind
    assert shape.radius == pytest.approx(radius)
    assert list(shape.model_dump(mode="json")) == [kind], "other kinds are not mentioned"
    assert Shape.model_validate_json(shape.model_dump_json(), strict=True) == shape


def test_a_shape_has_exactly_one_kind():
    with pytest.raises(ValidationError, match="this one has none"):
        Shape()
    with pytest.raises(ValidationError, match="this one has circle and box"):
        Shape(circle=Circle(radius=1.0), box=Box(length=1.0, width=1.0))


@pytest.mark.parametrize("start", range(4))
@pytest.mark.parametrize("order", [1, -1])
def test_a_polygon_runs_counter_clockwise_however_it_was_written(start, order):
    written = (SQUARE[start:] + SQUARE[:start])[::order]
    x, y = np.array(Polygon(vertices=written).vertices).T
    assert np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) == 2.0, "twice its area"


def test_corners_along_a_side_make_a_polygon_no_less_convex():
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
def test_a_polygon_that_is_none_is_refused(vertices, said):
    with pytest.raises(ValidationError, match=said):
        Polygon(vertices=vertices)


@given(st.integers(3, 40), st.floats(0, 7), st.floats(1e-3, 1e3), st.floats(0.01, 1), st.floats(-1e3, 1e3))
def test_corners_in_order_on_an_ellipse_are_a_polygon(count, start, size, flat, offset):
    angles = start + np.arange(count) * 2 * np.pi / count
    corners = [(offset + size * math.cos(angle), flat * size * math.sin(angle)) for angle in angles]
    assert len(Polygon(vertices=corners).vertices) == count


def test_a_wall_goes_somewhere():
    with pytest.raises(ValidationError, match="points 1 and 2 are the same"):
        Wall(points=[(0, 0), (1, 0), (1, 0)])
    with pytest.raises(ValidationError, match="at least 2 points, not 1"):
        Wall(points=[(0, 0)])


def test_a_wall_is_scenery_and_no_agent():
    wall = Shape(wall=Wall(points=[(0, 0), (1, 0)]))
    assert Obstacle(shape=wall).pose().position == (0.0, 0.0), "its points are positions in the world"
    with pytest.raises(ValidationError, match="an agent cannot be a wall"):
        Entity(shape=wall)


def test_an_obstacle_stands_somewhere_or_moves():
    assert Obstacle(shape=DISC, position=(1, 2, 3), heading=0.5).pose(9.0) == ((1, 2, 3), 0.5, (0, 0, 0), 0.0)
    with pytest.raises(ValidationError, match="it needs a position"):
        Obstacle(shape=DISC)
    with pytest.raises(ValidationError, match="leave position out"):
        Obstacle(shape=DISC, position=(0, 0), path=ScriptedPath(times=(0, 1), positions=((0, 0), (1, 1))))


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
def test_what_moves_goes_straight_from_position_to_position_and_rests_before_and_after(
    time, position, heading, velocity, turn_rate
):
    assert Obstacle(shape=DISC, path=ScriptedPath(**PATH)).pose(time) == (position, heading, velocity, turn_rate)


@pytest.mark.parametrize("turns", [0, 1, 7])
@pytest.mark.parametrize("time", [1.0, 1.5, 2.0, 3.5])
def test_what_repeats_begins_anew_at_the_last_time(turns, time):
    path, once = ScriptedPath(**PATH, repeat=True), ScriptedPath(**PATH)
    assert path.pose(time + 3.0 * turns) == once.pose(time)
    assert path.pose(0.5) == once.pose(0.5), "it rests before the first time"


def test_without_headings_what_moves_keeps_its_own():
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
def test_a_path_that_does_not_fit_together_is_refused(change, said):
    with pytest.raises(ValidationError, match=said):
        ScriptedPath(**{**PATH, **change})


SOUND = """\
symaware: 1
name: shapes
run: {duration: 1.0}
environment:
  use: kinematic
  entities:
    it: {shape: {circle: {radius: 1.0}}, position: [5, 0]}
agents: {robot: {model: {use: unicycle}, entity: {shape: {circle: {radius: 0.1}}}}}
"""


@pytest.mark.parametrize(
    ("entity", "path", "said"),
    [
        ("{shape: {box: {length: 1, width: -2}}, position: [0, 0]}", "shape.box.width", "is -2"),
        ("{shape: {crcle: {radius: 1}}, position: [0, 0]}", "shape.crcle", "unknown key `crcle`"),
        (
            "{shape: {}, position: [0, 0]}",
            "shape",
            "exactly one kind of circle, box, cylinder, polygon, wall, mesh, urdf",
        ),
        ("{shape: {circle: {radius: 1}}}", "", "it needs a position"),
        ("{shape: {circle: {radius: 1}}, position: [0]}", "position", "2 or 3 coordinates are needed, not 1"),
        ('{shape: {circle: {radius: 1}}, position: [0, "1"]}', "position.1", "is the text `1`"),
        ("{shape: {wall: {points: [[0, 0], [0, 0]]}}}", "shape.wall.points", "points 0 and 1 are the same"),
        (
            "{shape: {polygon: {vertices: [[0, 0], [2, 0], [0.1, 0.1], [0, 2]]}}, position: [0, 0]}",
            "shape.polygon.vertices",
            "not convex",
        ),
        (
            "{shape: {polygon: {vertices: [[0, 0], [2], [0, 2]]}}, position: [0, 0]}",
            "shape.polygon.vertices.1",
            "2 coordinates are needed, not 1",
        ),
        (
            "{shape: {circle: {radius: 1}}, path: {times: [1, 0], positions: [[0, 0], [1, 1]]}}",
            "path.times",
            "do not ascend",
        ),
    ],
)
def test_a_wrong_obstacle_in_a_file_is_reported_once_where_it_is_wrong(tmp_path: Path, entity, path, said):
    file = tmp_path / "shapes.yaml"
    file.write_text(SOUND, encoding="utf-8")
    build(file)
    content = yaml.safe_load(SOUND)
    content["environment"]["entities"]["it"] = yaml.safe_load(entity)
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        build(file)
    (problem,) = caught.value.problems
    assert problem.path == f"environment.entities.it.{path}".rstrip(".")
    assert said in problem.message


def test_an_agent_that_is_a_wall_is_reported_and_so_is_a_name_that_is_taken(tmp_path: Path):
    file = tmp_path / "shapes.yaml"
    file.write_text(SOUND.replace("{circle: {radius: 0.1}}", "{wall: {points: [[0, 0], [1, 0]]}}"), encoding="utf-8")
    with pytest.raises(ScenarioError, match="an agent cannot be a wall"):
        build(file)
    file.write_text(SOUND.replace("it:", "robot:"), encoding="utf-8")
    with pytest.raises(ScenarioError, match="both a group and an entity of the name `robot`"):
        build(file)
