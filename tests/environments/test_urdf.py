"""URDF files, and what robots look like."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pybullet
import pybullet_data
import pytest

from symaware_cli.environments.urdf import UrdfError, articulation, parsed

DATA = pybullet_data.getDataPath()


def robot(folder: Path, text: str) -> Path:
    path = folder / "robot.urdf"
    path.write_text(f"<robot name='r'>{text}</robot>")
    return path


@pytest.fixture
def client() -> Iterator[int]:
    number = pybullet.connect(pybullet.DIRECT)
    yield number
    pybullet.disconnect(number)


@pytest.mark.parametrize("file", ["racecar/racecar.urdf", "r2d2.urdf", "kuka_iiwa/model.urdf", "pr2_gripper.urdf"])
def test_links_are_where_the_engine_has_them_however_joints_stand(client: int, file: str) -> None:
    described = articulation(Path(DATA, file))
    body = pybullet.loadURDF(f"{DATA}/{file}", flags=pybullet.URDF_IGNORE_VISUAL_SHAPES, physicsClientId=client)
    infos = [pybullet.getJointInfo(body, joint, client) for joint in range(pybullet.getNumJoints(body, client))]
    joints, links = ({info[column].decode(): info[0] for info in infos} for column in (1, 12))
    positions = np.random.default_rng(7).uniform(-0.5, 0.5, len(described.joints))
    for joint, position in zip(described.joints, positions.tolist(), strict=True):
        pybullet.resetJointState(body, joints[joint], position, physicsClientId=client)
    base = pybullet.multiplyTransforms(
        *pybullet.getBasePositionAndOrientation(body, client),
        *pybullet.invertTransform(*pybullet.getDynamicsInfo(body, -1, client)[3:5]),
    )
    places, turns = described.frames(positions)
    assert len(described.links) == len(links) + 1
    for link, place, turned in zip(described.links[1:], places[1:], turns[1:], strict=True):
        state = pybullet.getLinkState(body, links[link.name], computeForwardKinematics=True, physicsClientId=client)
        position, orientation = pybullet.multiplyTransforms(*base, place.tolist(), turned.tolist())
        assert position == pytest.approx(state[4], abs=1e-6)
        assert abs(np.dot(orientation, state[5])) == pytest.approx(1.0, abs=1e-6)


def test_colours_come_from_the_link_the_robot_or_the_file_beside_the_mesh(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\n")
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 0.1 0.2 0.3\n")
    path = robot(
        tmp_path,
        """<material name='red'><color rgba='1 0 0 1'/></material><link name='a'>
        <visual><geometry><sphere radius='1'/></geometry><material name='red'/></visual>
        <visual><geometry><box size='1 2 3'/></geometry><material><color rgba='0 1 0 0.5'/></material></visual>
        <visual><geometry><mesh filename='a.obj' scale='2 2 2'/></geometry></visual>
        <visual><geometry><mesh filename='b.obj'/></geometry></visual></link>""",
    )
    visuals = articulation(path, scale=0.5).links[0].visuals
    assert [visual.kind for visual in visuals] == ["sphere", "box", "mesh", "mesh"]
    assert [visual.size for visual in visuals] == [(0.5,), (0.5, 1.0, 1.5), (1, 1, 1), (0.5, 0.5, 0.5)]
    assert [visual.colour for visual in visuals] == [(1, 0, 0, 1), (0, 1, 0, 0.5), (0.1, 0.2, 0.3, 1.0), None]


def test_what_makes_no_sense_of_a_look_is_passed_over(tmp_path: Path) -> None:
    path = robot(
        tmp_path,
        """<link name='a'><visual/><visual><geometry/></visual><visual><geometry><cone/></geometry></visual>
        <visual><geometry><box size='1 wide'/></geometry></visual>
        <visual><origin xyz='1, 2, 3, 4' rpy='x'/><geometry><sphere radius='1'/></geometry></visual></link>
        <joint/><joint type='fixed'><parent link='a'/><child link='nowhere'/></joint>""",
    )
    (link,) = articulation(path).links
    (visual,) = link.visuals
    assert (visual.position, visual.orientation) == ((1, 2, 3), (0, 0, 0, 1))


def test_links_that_carry_each_other_in_a_circle_end(tmp_path: Path) -> None:
    joint = "<joint name='{0}{1}' type='fixed'><parent link='{0}'/><child link='{1}'/></joint>"
    links = "".join(f"<link name='{name}'/>" for name in "abc")
    path = robot(tmp_path, links + joint.format("a", "b") + joint.format("b", "c") + joint.format("c", "b"))
    with pytest.raises(UrdfError, match="form a loop"):
        articulation(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_entities_are_not_expanded(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "bomb.urdf"
    text = "<!DOCTYPE robot [<!ENTITY a 'ha'><!ENTITY b '&a;&a;'>]><robot><link name='&b;'/></robot>"
    path.write_text(text, encoding=encoding)
    with pytest.raises(UrdfError, match="document type"):
        parsed(path)


def test_a_file_without_end_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "long.urdf"
    with open(path, "wb") as file:
        file.truncate((16 << 20) + 1)
    with pytest.raises(UrdfError, match="longer than 16 MiB"):
        parsed(path)
