"""The positions of obstacles, and refusals of invalid ones."""

from pathlib import Path

import pytest
import yaml
from pydantic import ValidationError

from symaware_cli import Circle, Entity, Obstacle, ScriptedPath, Shape, Wall
from symaware_cli.language.build import build
from symaware_cli.language.problem import ScenarioError

DISC = Shape(circle=Circle(radius=1.0))


def test_a_wall_is_scenery_and_no_agent() -> None:
    wall = Shape(wall=Wall(points=[(0, 0), (1, 0)]))
    assert Obstacle(shape=wall).pose().position == (0.0, 0.0), "its points are positions in the world"
    with pytest.raises(ValidationError, match="an agent cannot be a wall"):
        Entity(shape=wall)


def test_an_obstacle_has_a_position_or_a_path() -> None:
    assert Obstacle(shape=DISC, position=(1, 2, 3), heading=0.5).pose(9.0) == ((1, 2, 3), 0.5, (0, 0, 0), 0.0)
    with pytest.raises(ValidationError, match="it needs a position"):
        Obstacle(shape=DISC)
    with pytest.raises(ValidationError, match="leave position out"):
        Obstacle(shape=DISC, position=(0, 0), path=ScriptedPath(times=(0, 1), positions=((0, 0), (1, 1))))


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
        ('{shape: {circle: {radius: 1}}, position: [0, "1"]}', "position[1]", "is the text `1`"),
        ("{shape: {wall: {points: [[0, 0], [0, 0]]}}}", "shape.wall.points", "points 0 and 1 are the same"),
        (
            "{shape: {polygon: {vertices: [[0, 0], [2, 0], [0.1, 0.1], [0, 2]]}}, position: [0, 0]}",
            "shape.polygon.vertices",
            "not convex",
        ),
        (
            "{shape: {polygon: {vertices: [[0, 0], [2], [0, 2]]}}, position: [0, 0]}",
            "shape.polygon.vertices[1]",
            "2 coordinates are needed, not 1",
        ),
        (
            "{shape: {circle: {radius: 1}}, path: {times: [1, 0], positions: [[0, 0], [1, 1]]}}",
            "path.times",
            "do not ascend",
        ),
    ],
)
def test_a_wrong_obstacle_in_a_file_is_reported_once_where_it_is_wrong(
    tmp_path: Path, entity: str, path: str, said: str
) -> None:
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


def test_an_agent_that_is_a_wall_is_reported_and_so_is_a_name_that_is_taken(tmp_path: Path) -> None:
    file = tmp_path / "shapes.yaml"
    file.write_text(SOUND.replace("{circle: {radius: 0.1}}", "{wall: {points: [[0, 0], [1, 0]]}}"), encoding="utf-8")
    with pytest.raises(ScenarioError, match="an agent cannot be a wall"):
        build(file)
    file.write_text(SOUND.replace("it:", "robot:"), encoding="utf-8")
    with pytest.raises(ScenarioError, match="`robot` is the name of both a group and an entity"):
        build(file)
