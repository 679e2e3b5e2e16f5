"""MJCF files: the parts that are a robot, the files that they include, and the places of problems."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from symaware_cli.assets.asset import AssetFolders, check, described, needed
from symaware_cli.assets.mjcf import MjcfDescription
from symaware_cli.core import Obstacle, WorldError
from symaware_cli.engine.environments.appearance import appearance
from symaware_cli.geometry import Shape

CUBE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
LEG = '<body name="leg" pos="0 0 -.1"><joint name="hip" axis="0 2 0"/><geom size=".1"/></body>'


def robot(inner: str = LEG, around: str = "", of_body: str = "") -> bytes:
    body = f'<body name="base"{of_body}><geom type="box" size=".1 .1 .1"/>{inner}</body>'
    return f"<mujoco>{around}<worldbody>{body}</worldbody></mujoco>".encode()


def read(inner: str = LEG, around: str = "") -> MjcfDescription:
    return MjcfDescription(robot(inner, around))


def refusal(folder: Path, data: bytes, **others: bytes) -> str:
    (folder / "robot.xml").write_bytes(data)
    for name, content in others.items():
        (folder / f"{name}.xml").write_bytes(content)
    with pytest.raises(WorldError) as refused:
        check("robot.xml", AssetFolders(folder))
    return str(refused.value)


# -- reading


def test_lights_sensors_options_and_the_floor_are_no_part_of_a_robot() -> None:
    scene = """<mujoco><option timestep="1"/><visual/><statistic/><size/><asset><texture file="a.png"/>
    <material name="m" rgba="1 0 0 1"/></asset><worldbody><light/><geom type="plane" size="1 1 1"/>
    <body name="base"><freejoint/><camera/><geom size=".1" material="m"/></body></worldbody>
    <sensor><gyro site="s"/></sensor><keyframe/></mujoco>"""
    found = MjcfDescription(scene.encode())
    assert sorted({str(each.tag) for each in found.root}) == ["asset", "compiler", "worldbody"]
    assert [str(each.tag) for each in found.root.iter("geom")] == ["geom"]
    assert not found.joints()
    assert found.articulation({}).links[0].visuals[0].colour == (1.0, 0.0, 0.0, 1.0)


def test_angles_are_degrees_unless_the_compiler_says_radian() -> None:
    leg = LEG.replace("axis", 'range="-90 90" axis')
    (joint,) = read(leg).joints().values()
    assert (joint.lower, joint.upper) == pytest.approx((-np.pi / 2, np.pi / 2))
    (joint,) = read(leg, '<compiler angle="radian"/>').joints().values()
    assert joint.upper == 90
    (joint,) = read(leg, '<compiler autolimits="false"/>').joints().values()
    assert np.isinf(joint.upper)


def test_defaults_are_those_of_the_class_of_the_nearest_body_and_of_the_classes_around_it() -> None:
    defaults = """<default><joint damping="1" actuatorfrcrange="-1 1"/><default class="strong">
    <joint type="slide"/><default class="stronger"><joint actuatorfrcrange="-9 9"/></default></default></default>"""
    inner = """<body childclass="strong"><joint name="one"/><geom size=".1"/>
    <body childclass="stronger"><joint name="two"/><geom size=".1"/></body>
    <body><joint name="three" class="main"/><geom size=".1"/></body></body>"""
    joints = read(inner, defaults).joints()
    assert [(each.turns, each.effort) for each in joints.values()] == [(False, 1.0), (False, 9.0), (True, 1.0)]


@pytest.mark.parametrize(
    ("actuator", "effort"),
    [
        ('<motor joint="hip" ctrlrange="-3 3" gear="10"/>', 30.0),
        ('<position joint="hip" forcerange="-7 5"/>', 7.0),
        ('<velocity joint="hip" ctrlrange="-3 3"/>', np.inf),
        ('<general class="g" joint="hip"/>', 4.0),
    ],
)
def test_the_effort_of_a_joint_is_the_greatest_force_of_its_actuator(actuator: str, effort: float) -> None:
    defaults = '<default><default class="g"><general forcerange="-4 4"/></default></default>'
    (joint,) = read(LEG, f"{defaults}<actuator>{actuator}</actuator>").joints().values()
    assert joint.effort == effort


@pytest.mark.parametrize(
    ("way", "expected"),
    [
        ('euler="90 0 0"', (np.sqrt(0.5), 0, 0, np.sqrt(0.5))),
        ('quat="2 2 0 0"', (np.sqrt(0.5), 0, 0, np.sqrt(0.5))),
        ('axisangle="3 0 0 90"', (np.sqrt(0.5), 0, 0, np.sqrt(0.5))),
        ('zaxis="0 -2 0"', (np.sqrt(0.5), 0, 0, np.sqrt(0.5))),
        ('xyaxes="1 0 0 0 0 3"', (np.sqrt(0.5), 0, 0, np.sqrt(0.5))),
        ('euler="90 90 0"', (0.5, 0.5, 0.5, 0.5)),
    ],
)
def test_orientations_may_be_written_in_each_way(way: str, expected: Any) -> None:
    found = read(LEG.replace('pos="0 0 -.1"', way)).articulation({}).links[1].orientation
    assert found == pytest.approx(expected, abs=1e-12) or np.negative(found) == pytest.approx(expected, abs=1e-12)


def test_a_joint_away_from_the_origin_of_its_body_turns_the_body_about_itself() -> None:
    leg = LEG.replace('axis="0 2 0"', 'axis="0 0 1" pos="1 0 0"')
    positions, _ = read(leg).articulation({}).frames([np.pi / 2])
    assert positions[-1] == pytest.approx([1.0, -1.0, -0.1])


def test_several_joints_of_a_body_follow_each_other() -> None:
    leg = LEG.replace("<geom", '<joint name="slide" type="slide" axis="1 0 0"/><geom')
    described = read(leg).articulation({})
    assert list(described.joints) == ["hip", "slide"]
    positions, _ = described.frames([np.pi / 2, 0.5])
    assert positions[-1] == pytest.approx([0.0, 0.0, -0.6])


def test_wheels_are_as_large_as_the_round_shape_that_a_joint_carries() -> None:
    assert read().rolling_radius("hip") == 0.1
    assert read(LEG.replace('size=".1"', 'type="box" size="1 1 1"')).rolling_radius("hip") is None


def test_shapes_that_do_not_collide_are_visual() -> None:
    both = '<geom size=".1"/><geom type="capsule" fromto="0 0 0 0 0 .4" size=".02" contype="0" conaffinity="0"/>'
    (seen,) = read(LEG.replace('<geom size=".1"/>', both)).articulation({}).links[1].visuals
    assert (seen.kind, seen.size, seen.position) == ("capsule", (0.02, 0.4), (0.0, 0.0, 0.2))


# -- files


def scattered(folder: Path) -> AssetFolders:
    """A robot in three files, with a mesh in a folder."""
    (folder / "r" / "meshes").mkdir(parents=True)
    (folder / "r" / "meshes" / "cube.obj").write_text(CUBE)
    (folder / "r" / "robot.xml").write_bytes(robot('<include file="leg.xml"/>', '<include file="assets.xml"/>'))
    (folder / "r" / "assets.xml").write_text(
        '<mujoco><compiler meshdir="meshes"/>'
        '<asset><mesh name="cube" file="cube.obj" scale=".1 .1 .1"/></asset></mujoco>'
    )
    (folder / "r" / "leg.xml").write_text(
        '<mujocoinclude><body name="leg"><joint name="hip"/><geom type="mesh" mesh="cube"/></body></mujocoinclude>'
    )
    return AssetFolders(folder)


def test_included_files_and_meshes_are_found_and_stored_in_a_log(tmp_path: Path) -> None:
    folders = scattered(tmp_path)
    files = ["r/assets.xml", "r/leg.xml", "r/meshes/cube.obj", "r/robot.xml"]
    assert sorted(needed("r/robot.xml", folders)) == files
    found = described("r/robot.xml", folders)
    assert list(found.description.joints()) == ["hip"]
    looks = appearance(Shape.model_validate({"mjcf": {"file": "r/robot.xml", "radius": 1.0}}), folders, 1.0)
    assert looks.links[1].visuals[0].mesh == str(tmp_path.resolve() / "r/meshes/cube.obj")


def test_a_problem_in_an_included_file_is_located_there(tmp_path: Path) -> None:
    said = refusal(
        tmp_path,
        robot('<include file="leg.xml"/>'),
        leg=b'<mujocoinclude>\n<body name="leg"><joint type="ball"/></body></mujocoinclude>',
    )
    assert said.startswith("leg.xml:2:18: the joint `joint0` is `ball`, none that turns or slides")


def test_files_do_not_include_themselves_or_lead_out_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "outside.xml").write_bytes(b"<mujoco/>")
    home = tmp_path / "home"
    home.mkdir()
    circle = {
        "one": b'<mujoco><include file="two.xml"/></mujoco>',
        "two": b'<mujoco><include file="one.xml"/></mujoco>',
    }
    assert "`one.xml` includes itself" in refusal(home, robot("", '<include file="one.xml"/>'), **circle)
    for name in ("../outside.xml", "/etc/passwd", "file:///etc/passwd"):
        assert "it includes" in refusal(home, robot("", f'<include file="{name}"/>'))
    assert "which is not there" in refusal(home, robot("", '<include file="absent.xml"/>'))
    (home / "link.xml").symlink_to(tmp_path / "outside.xml")
    assert "leads out of its folder" in refusal(home, robot("", '<include file="link.xml"/>'))
    mesh = '<asset><mesh name="m" file="../../m.obj"/></asset>'
    assert "robot.xml:1:16: it names the mesh `../../m.obj`, which leads out" in refusal(home, robot("", mesh))


# -- refusals


@pytest.mark.parametrize(
    ("inner", "around", "said"),
    [
        ("", '<!DOCTYPE x [<!ENTITY a "b">]>', "no XML|document type"),
        ('<joint name="x"/>', "", "moves the robot's base"),
        (LEG + LEG, "", "the body `leg` exists twice"),
        (LEG + LEG.replace("leg", "other"), "", "the joint `hip` exists twice"),
        (LEG.replace("axis", 'type="ball" axis'), "", "the joint `hip` is `ball`"),
        (LEG.replace("0 2 0", "0 0 0"), "", "the axis of the joint `hip` has no direction"),
        (LEG.replace("0 2 0", "0 2"), "", "has 2 numbers; it has 3 numbers"),
        (LEG.replace("0 2 0", "0 two 0"), "", "`two` is no number"),
        (LEG.replace("axis", 'ref="1" axis'), "", "has a reference position"),
        (LEG.replace("axis", 'class="c" axis'), "", "there are no defaults of the class `c`"),
        (LEG.replace("-.1", "inf"), "", "`inf` is no number"),
        ('<geom type="hfield" hfield="h"/>', "", "`hfield` is no shape of a robot"),
        ('<geom type="mesh" mesh="m"/>', "", "there is no mesh `m` in `asset`"),
        ('<geom type="capsule" size=".1"/>', "", "a `capsule` has 2 sizes greater than 0"),
        ('<geom size="-1"/>', "", "a `sphere` has 1 sizes greater than 0"),
        ("<composite/>", "", "`composite` in a body is not read"),
        ("<flexcomp/>", "", "`flexcomp` in a body is not read"),
        ('<body mocap="true"/>', "", "no robot"),
        ('<body quat="0 0 0 0"/>', "", "has no direction"),
        ('<body quat="1 0 0 0" euler="0 0 0"/>', "", "it has one orientation, not `quat` and `euler`"),
        ("", '<extension><plugin plugin="x"/></extension>', "`extension` is no section of a robot"),
        ("", "<deformable/>", "`deformable` is no section of a robot"),
        ("", '<asset><hfield file="h.png"/></asset>', "`hfield` is no asset"),
        ("", '<asset><model file="m.xml"/></asset>', "`model` is no asset"),
        ("", '<asset><mesh builtin="sphere"/></asset>', "`mesh` is no asset"),
        ("", '<tendon><spatial range="0 1"/></tendon>', "a tendon with forces of its own"),
        ("", "<equality><flex/></equality>", "the equality `flex` is not read"),
        ("", '<worldbody><body name="b"/></worldbody>', "a robot is one `body` in `worldbody`; this file has 2"),
        ("", '<worldbody><geom size="1"/></worldbody>', "a shape outside of the robot's body"),
        ("", '<compiler coordinate="global"/>', "coordinates are `local`"),
        ("", '<compiler eulerseq="xyw"/>', "has three letters"),
        ("", "<default><default/></default>", "a nested `default` has a class"),
        ('<geom size=".1" mass="heavy"/>', "", "`heavy` is no number"),
        ('<geom size=".1" friction="nan"/>', "", "`nan` is no number"),
        ('<site pos="1e300 0 0"/>', "", "has a number over 1e+09"),
        ("", '<default><joint damping="1 x"/></default>', "`x` is no number"),
        ("", '<actuator><motor joint="absent"/></actuator>', "there is no joint `absent`"),
    ],
)
def test_unsupported_content_is_refused_with_its_line(inner: str, around: str, said: str, tmp_path: Path) -> None:
    told = refusal(tmp_path, b"\n" + robot(inner, around))
    assert told.startswith("robot.xml:2:")
    assert any(each in told for each in said.split("|"))


def test_other_and_oversized_files_are_refused(tmp_path: Path) -> None:
    assert "it describes no robot" in refusal(tmp_path, b"<robot/>")
    assert "it is no XML" in refusal(tmp_path, b"\x00\xff")
    assert "nested more than 100 deep" in refusal(tmp_path, robot("<body>" * 200 + "</body>" * 200))
    many = "".join(f'<body name="b{number}"/>' for number in range(1_001))
    assert "more than 1,000 bodies" in refusal(tmp_path, robot(many))


def test_a_world_without_mechanisms_names_the_missing_feature(tmp_path: Path) -> None:
    from symaware_cli.worlds.spatial import PyBulletEnvironment

    (tmp_path / "robot.xml").write_bytes(robot())
    thing = Obstacle.model_validate({"shape": {"mjcf": {"file": "robot.xml", "radius": 1.0}}, "position": [0, 0, 1]})
    environment = PyBulletEnvironment()
    environment.folder = tmp_path
    with pytest.raises(WorldError, match="no robots from MJCF files") as refused:
        environment.initialise([], {"thing": thing}, 1)
    assert refused.value.path == ("environment", "entities", "thing", "shape", "mjcf")
    assert refused.value.needs == "mechanisms"
