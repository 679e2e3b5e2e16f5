"""Meshes that a URDF names by package: the folders that are searched, and the copies in logs."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from checkout import CHECKOUT

from symaware_cli import open_log
from symaware_cli.assets.mesh_file import stl
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.files import open_scenario
from symaware_cli.language.problem import ScenarioError
from symaware_cli.log.digest import digest

MESH = stl(
    np.array(
        [[[0, 0, 0], [0, 1, 0], [1, 0, 0]], [[0, 0, 0], [1, 0, 0], [0, 0, 1]], [[1, 0, 0], [0, 1, 0], [0, 0, 1]]], float
    )
)
MANIFEST = "<?xml version='1.0'?><package><name> arm </name></package>"
URDF = """<robot name="r"><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
<collision><geometry><mesh filename="{}"/></geometry></collision></link></robot>"""


def write(path: Path, content: str | bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)


def scenario(folder: Path, file: str, **more: Any) -> Path:
    thing = {"shape": {"urdf": {"file": file, "radius": 1.0}}, "position": [0, 0, 1]}
    content = {
        "symaware": 1,
        "name": "arm",
        "run": {"duration": 0.1},
        "environment": {"use": "pybullet", "entities": {"thing": thing}},
        "agents": {"robot": {"model": {"use": "unicycle"}, "state": [5, 0, 0]}},
        **more,
    }
    write(folder / "s.yaml", yaml.safe_dump(content))
    return folder / "s.yaml"


def problem(path: Path) -> str:
    with pytest.raises(ScenarioError) as refused:
        build(path)
    (found,) = refused.value.problems
    assert found.path == "environment.entities.thing.shape.urdf.file"
    return found.message


@pytest.mark.parametrize(
    ("urdf", "mesh", "manifest"),
    [
        ("arm/urdf/r.urdf", "arm/meshes/b.stl", None),  # a folder above, called like the package
        ("arm/urdf/one/r.urdf", "arm/meshes/b.stl", None),
        ("other/urdf/r.urdf", "other/meshes/b.stl", "other/package.xml"),  # one whose package.xml has the name
        ("urdf/r.urdf", "meshes/b.stl", "package.xml"),  # the scenario's folder itself
        ("robot/urdf/r.urdf", "arm/meshes/b.stl", None),  # beside the package of the robot
        ("r.urdf", "arm/meshes/b.stl", None),
    ],
)
@pytest.mark.parametrize("scheme", ["package", "model"])
def test_a_package_is_found_above_the_urdf_and_a_log_has_its_files(
    tmp_path: Path, urdf: str, mesh: str, manifest: str | None, scheme: str
) -> None:
    home = tmp_path / "home"
    write(home / urdf, URDF.format(f"{scheme}://arm/meshes/b.stl"))
    write(home / mesh, MESH)
    if manifest:
        write(home / manifest, MANIFEST)
    execute(build(scenario(home, urdf)), tmp_path / "first.mcap")
    home.rename(tmp_path / "away")
    execute(open_scenario(tmp_path / "first.mcap"), tmp_path / "again.mcap")
    first, second = (digest(open_log(tmp_path / name)) for name in ("first.mcap", "again.mcap"))
    assert first.combined == second.combined


SEEN = """<robot name="r"><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
<visual><geometry><mesh filename="package://arm/lost.stl"/></geometry></visual>
<visual><geometry><sphere radius="0.1"/></geometry></visual>
<collision><geometry><box size="1 1 1"/></geometry></collision></link></robot>"""


@pytest.mark.parametrize("world", ["kinematic", "pybullet"])
def test_a_missing_visual_mesh_gives_a_warning(tmp_path: Path, world: str) -> None:
    write(tmp_path / "r.urdf", SEEN)
    path = scenario(tmp_path, "r.urdf")
    path.write_text(path.read_text().replace("use: pybullet", f"use: {world}"))
    built = build(path)
    (warning,) = (each for each in built.find_warnings() if each.code == "shapes-left-out")
    assert warning.path == "environment.entities.thing.shape.urdf.file"
    assert "r.urdf:2:19: it names the mesh `package://arm/lost.stl`, which is not there" in warning.message
    execute(built, tmp_path / "first.mcap")
    execute(open_scenario(tmp_path / "first.mcap"), tmp_path / "again.mcap")
    first, second = (digest(open_log(tmp_path / name)) for name in ("first.mcap", "again.mcap"))
    assert first.combined == second.combined


@pytest.mark.parametrize("world", ["kinematic", "pybullet"])
def test_a_collision_mesh_may_be_missing_only_if_the_scenario_says_so(tmp_path: Path, world: str) -> None:
    write(tmp_path / "r.urdf", SEEN.replace("visual>", "collision>", 2))
    path = scenario(tmp_path, "r.urdf")
    strict = yaml.safe_load(path.read_text().replace("use: pybullet", f"use: {world}"))
    path.write_text(yaml.safe_dump(strict))
    with pytest.raises(ScenarioError) as raised:
        build(path)
    assert "`missing: leave-out` beside `file` loads the robot without it" in raised.value.problems[0].message
    strict["environment"]["entities"]["thing"]["shape"]["urdf"]["missing"] = "leave-out"
    path.write_text(yaml.safe_dump(strict))
    built = build(path)
    (warning,) = (each for each in built.find_warnings() if each.code == "shapes-left-out")
    assert "r.urdf:2:22: it names the mesh `package://arm/lost.stl`, which is not there" in warning.message
    execute(built, tmp_path / "first.mcap")
    execute(open_scenario(tmp_path / "first.mcap"), tmp_path / "again.mcap")
    first, second = (digest(open_log(tmp_path / name)) for name in ("first.mcap", "again.mcap"))
    assert first.combined == second.combined


EMPTY = """<robot><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
<collision><geometry><box size="1 1 0"/></geometry></collision>
<collision><geometry><{}/></geometry></collision></link></robot>"""


@pytest.mark.parametrize("world", ["kinematic", "pybullet"])
@pytest.mark.parametrize(
    "shape", ["sphere radius='0'", "cylinder radius='0' length='1'", "capsule radius='1' length='0'"]
)
def test_collision_shapes_of_the_size_0_are_left_out_with_a_warning(tmp_path: Path, world: str, shape: str) -> None:
    write(tmp_path / "r.urdf", EMPTY.format(shape))
    path = scenario(tmp_path, "r.urdf")
    path.write_text(path.read_text().replace("use: pybullet", f"use: {world}"))
    built = build(path)
    (warning,) = (each for each in built.find_warnings() if each.code == "shapes-left-out")
    assert warning.path == "environment.entities.thing.shape.urdf.file"
    assert "r.urdf:2:22: the `size` of a box is 0, which collides with nothing, and 1 more" in warning.message
    execute(built, tmp_path / "log.mcap")


def test_the_nearest_package_counts(tmp_path: Path) -> None:
    write(tmp_path / "arm" / "inner" / "arm" / "r.urdf", URDF.format("package://arm/b.stl"))
    write(tmp_path / "arm" / "inner" / "arm" / "b.stl", MESH)
    write(tmp_path / "arm" / "b.stl", b"damaged")
    assert "arm/inner/arm/b.stl" in build(scenario(tmp_path, "arm/inner/arm/r.urdf")).files


@pytest.mark.parametrize("inner", ["arm/meshes/b.stl", "meshes/b.stl"])
def test_further_folders_are_searched_if_the_scenario_names_them(tmp_path: Path, inner: str) -> None:
    home, share = tmp_path / "home", tmp_path / "share"
    write(home / "r.urdf", URDF.format("package://arm/meshes/b.stl"))
    write(share / inner, MESH)
    if inner == "meshes/b.stl":
        write(share / "package.xml", MANIFEST)
    said = problem(scenario(home, "r.urdf"))
    assert said.startswith("r.urdf:2:") is True
    assert "`package://arm/meshes/b.stl`, which is not there; looked for arm/meshes/b.stl" in said
    execute(build(scenario(home, "r.urdf", assets=["../share"])), tmp_path / "first.mcap")
    log = open_log(tmp_path / "first.mcap")
    assert log.attachments["scenario/arm/meshes/b.stl"] == MESH
    (share / inner).unlink()
    execute(open_scenario(tmp_path / "first.mcap"), tmp_path / "again.mcap")
    assert digest(log).combined == digest(open_log(tmp_path / "again.mcap")).combined


def test_robots_of_further_folders_are_found_after_those_of_the_scenario(tmp_path: Path) -> None:
    home, share = tmp_path / "home", tmp_path / "share"
    write(share / "arm" / "r.urdf", URDF.format("package://arm/b.stl"))
    write(share / "arm" / "b.stl", MESH)
    files = build(scenario(home, "arm/r.urdf", assets=[str(share)])).files
    assert {"arm/r.urdf", "arm/b.stl"} <= set(files)


def test_folders_of_a_base_are_relative_to_it(tmp_path: Path) -> None:
    write(tmp_path / "share" / "arm" / "b.stl", MESH)
    write(tmp_path / "home" / "base" / "r.urdf", URDF.format("package://arm/b.stl"))
    scenario(tmp_path / "home" / "base", "r.urdf", assets=["../../share"])
    write(tmp_path / "home" / "top.yaml", "extends: base/s.yaml")
    assert "arm/b.stl" in build(tmp_path / "home" / "top.yaml").files


def test_a_missing_further_folder_is_reported_only_with_a_missing_file(tmp_path: Path) -> None:
    write(tmp_path / "r.urdf", URDF.format("package://arm/b.stl"))
    path = scenario(tmp_path, "r.urdf", assets=["nowhere"])
    with pytest.raises(ScenarioError) as refused:
        build(path)
    file = "environment.entities.thing.shape.urdf.file"
    found = {(each.code, each.path) for each in refused.value.problems}
    assert found == {("unsuitable", file), ("missing-file", "assets[0]")}
    write(tmp_path / "arm" / "b.stl", MESH)
    assert ("missing-file", "assets[0]") in {(each.code, each.path) for each in build(path).find_warnings()}


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("package://arm/../b.stl", "`..` leads out of the package"),
        ("package://../b.stl", "`..` leads out of the package"),
        ("../../b.stl", "leads out of its folder"),
        ("/etc/b.stl", "a path is relative to the file"),
        ("file:///etc/b.stl", "a path is relative to the file"),
        ("http://127.0.0.1:9/b.stl", "a path is relative to the file"),
        ("package://arm/linked.stl", "leads out of its folder"),
        ("package://linked/b.stl", "leads out of its folder"),
        ("package://nowhere/b.stl", "looked for arm/nowhere/b.stl, nowhere/b.stl"),
        ("package://arm", "a path is relative to the file"),
        ("package://arm/b.glb", "a collision mesh is an .obj, .stl or .dae file"),
    ],
)
def test_nothing_outside_of_the_folders_is_read(tmp_path: Path, name: str, said: str) -> None:
    home = tmp_path / "home"
    for folder in (tmp_path, tmp_path / "outside", home / "arm"):
        write(folder / "b.stl", MESH)
    write(home / "arm" / "b.glb", b"glTF")
    write(home / "arm" / "r.urdf", URDF.format(name))
    os.symlink(tmp_path / "b.stl", home / "arm" / "linked.stl")
    os.symlink(tmp_path / "outside", home / "linked")
    assert said in problem(scenario(home, "arm/r.urdf"))


def test_materials_outside_of_the_folders_are_refused(tmp_path: Path) -> None:
    write(tmp_path / "secret.mtl", "newmtl a\nKd 1 0 0\n")
    obj = "mtllib ../secret.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"
    write(tmp_path / "home" / "b.obj", obj)
    write(tmp_path / "home" / "r.urdf", URDF.format("b.obj"))
    assert "`../secret.mtl` leads out of the folder" in problem(scenario(tmp_path / "home", "r.urdf"))


def test_a_scenario_without_files_of_robots_imports_none_of_their_readers() -> None:
    code = "import sys\nfrom symaware_cli import load\nload(sys.argv[1])\nprint(*sys.modules)"
    hello = CHECKOUT / "scenarios" / "hello.yaml"
    done = subprocess.run([sys.executable, "-c", code, hello], capture_output=True, text=True, check=True)
    readers = {f"symaware_cli.assets.{name}" for name in ("collada", "mesh_file", "urdf", "xml_tree")}
    assert not readers & {*done.stdout.split()}


def test_a_package_in_a_folder_of_another_name_is_found_by_the_path_within_it(tmp_path: Path) -> None:
    write(tmp_path / "arm" / "meshes" / "b.stl", MESH)
    write(tmp_path / "arm" / "urdf" / "r.urdf", URDF.format("package://arm_support/meshes/b.stl"))
    log = tmp_path / "log.mcap"
    execute(build(scenario(tmp_path, "arm/urdf/r.urdf")), log)
    execute(open_scenario(log), tmp_path / "again.mcap")
    write(tmp_path / "arm" / "urdf" / "r.urdf", URDF.format("package://arm_support/other/b.stl"))
    assert "looked for" in problem(scenario(tmp_path, "arm/urdf/r.urdf"))
