"""Where obstacles are, and what is said of those that cannot be."""

from pathlib import Path

import pytest
import yaml
from pydantic import ValidationError

from symaware_cli import Circle, Entity, Obstacle, ScriptedPath, Shape, Wall
from symaware_cli.scenario.build import build
from symaware_cli.scenario.problem import ScenarioError

DISC = Shape(circle=Circle(radius=1.0))


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


def test_a_course_leads_to_where_the_path_is_next():
    path = ScriptedPath(**PATH)
    assert path.course(1.5, 0.5) == path.pose(1.5)
    # A turn at half of the span: 1 m along x and 1.5 m along y.
    assert path.course(1.5, 1.0) == ((1, 0), 0.5, (1, 1.5), 0.0)


@pytest.mark.parametrize("early", [0.25, 1e-9])
def test_a_jump_is_no_motion(early):
    jumping = ScriptedPath(**PATH, repeat=True)
    assert jumping.course(4.0 - early, 0.5) == jumping.pose(4.0 - early)
    assert jumping.course(7.0 - early, 0.5) == jumping.pose(7.0 - early)
    assert jumping.course(4.0, 0.5) == jumping.pose(1.0)
    turning = ScriptedPath(times=(0, 1), positions=((0, 0), (0, 0)), headings=(0.0, 6.0), repeat=True)
    assert turning.course(1.0 - early, 0.5).turn_rate == 6.0


def test_a_path_that_closes_goes_on_where_it_begins_anew():
    path = ScriptedPath(times=(0, 1, 2), positions=((0, 0), (1, 0), (0, 0)), repeat=True)
    assert path.course(1.75, 0.5) == ((0.25, 0), 0.0, (0, 0), 0.0)


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
