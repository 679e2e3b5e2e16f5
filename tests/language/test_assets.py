"""The files of shapes: found, reported if missing, and stored in logs."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.files import open_scenario
from symaware_cli.language.problem import ScenarioError
from symaware_cli.log.digest import digest

TETRAHEDRON = """mtllib paint/red.mtl
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
usemtl red
f 1 3 2
f 1 2 4
f 2 3 4
f 1 4 3
"""
ROBOT = (
    '<robot name="r"><link name="l"><visual><geometry><mesh filename="tent.obj"/></geometry></visual></link></robot>'
)


def scenario(world: str, *shapes: Any) -> Any:
    entities = {f"thing{number}": {"shape": shape, "position": [0, 0, 1]} for number, shape in enumerate(shapes)}
    robot = {"model": {"use": "unicycle"}, "state": [5, 0, 0]}
    environment = {"use": world, "entities": entities}
    return {
        "symaware": 1,
        "name": "tents",
        "run": {"duration": 0.1},
        "environment": environment,
        "agents": {"robot": robot},
    }


def mesh(file: str) -> Any:
    return {"mesh": {"file": file, "radius": 1.0}}


def write(path: Path, content: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))


def problems(path: Path) -> Any:
    with pytest.raises(ScenarioError) as caught:
        build(path)
    return [(problem.code, problem.path) for problem in caught.value.problems]


@pytest.mark.parametrize("world", ["kinematic", "pymunk", "pybullet"])
def test_all_missing_features_are_reported_in_every_world_where_they_are_named(world: str, tmp_path: Path) -> None:
    write(tmp_path / "bent.urdf", "<robot")
    shapes = [mesh("none.obj"), {"urdf": {"file": "bent.urdf", "radius": 1.0}}, mesh("nor.stl")]
    write(tmp_path / "tents.yaml", scenario(world, *shapes))
    where = "environment.entities.thing{}.shape.{}.file"
    assert problems(tmp_path / "tents.yaml") == [
        ("missing-file", where.format(0, "mesh")),
        ("unsuitable", where.format(1, "urdf")),
        ("missing-file", where.format(2, "mesh")),
    ]


def test_a_file_lies_beside_the_one_that_names_it(tmp_path: Path) -> None:
    write(tmp_path / "base" / "tent.obj", TETRAHEDRON)
    write(
        tmp_path / "base" / "tents.yaml",
        scenario("kinematic", mesh("${parameters.tent}")) | {"parameters": {"tent": "tent.obj"}},
    )
    write(tmp_path / "top.yaml", {"extends": "base/tents.yaml"})
    for name in ("base/tents.yaml", "top.yaml"):
        built = build(tmp_path / name)
        assert "tent.obj" in {name.rpartition("/")[2] for name in built.files}
    # What the top file names is looked for beside the top file, even within a shape of the base.
    entities = {"thing0": {"shape": {"mesh": {"file": "other.obj"}}}}
    write(tmp_path / "top.yaml", {"extends": "base/tents.yaml", "environment": {"entities": entities}})
    write(tmp_path / "other.obj", TETRAHEDRON)
    assert "other.obj" in build(tmp_path / "top.yaml").files
    with pytest.raises(ScenarioError):
        build(tmp_path / "top.yaml", ["environment.entities.thing0.shape.mesh.file=tent.obj"])


def test_a_log_has_the_colours_of_its_meshes_too(tmp_path: Path) -> None:
    write(tmp_path / "in" / "tent.obj", TETRAHEDRON)
    write(tmp_path / "in" / "paint" / "red.mtl", "newmtl red\nKd 1 0 0\nmap_Kd -clamp on stripes.png\n")
    write(tmp_path / "in" / "paint" / "stripes.png", "not looked at")
    write(tmp_path / "in" / "robot.urdf", ROBOT)
    write(tmp_path / "tents.yaml", scenario("kinematic", {"urdf": {"file": "in/robot.urdf", "radius": 1.0}}))
    execute(build(tmp_path / "tents.yaml"), tmp_path / "first.mcap")
    log = open_log(tmp_path / "first.mcap")
    for name in ("robot.urdf", "tent.obj", "paint/red.mtl", "paint/stripes.png"):
        assert log.attachments[f"scenario/in/{name}"] == (tmp_path / "in" / name).read_bytes()
    execute(open_scenario(tmp_path / "first.mcap"), tmp_path / "again.mcap")
    assert digest(log).combined == digest(open_log(tmp_path / "again.mcap")).combined
