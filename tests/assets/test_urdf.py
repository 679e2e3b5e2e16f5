"""URDF files, and the visual shapes of robots."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pybullet
import pybullet_data
import pytest

from symaware_cli.assets.asset import AssetFolders, described
from symaware_cli.assets.asset_error import AssetError
from symaware_cli.assets.urdf import RobotDescription
from symaware_cli.core import Obstacle
from symaware_cli.geometry.articulation import Articulation
from symaware_cli.worlds.spatial import PyBulletEnvironment

DATA = pybullet_data.getDataPath()


def robot(folder: Path, text: str) -> Path:
    path = folder / "robot.urdf"
    path.write_text(f"<robot name='r'>{text}</robot>")
    return path


def articulation(path: Path, scale: float = 1.0) -> Articulation:
    found = described(path.name, AssetFolders(path.parent))
    return found.description.articulation(found.paths, scale)


@pytest.fixture
def client() -> Iterator[int]:
    number = pybullet.connect(pybullet.DIRECT)
    yield number
    pybullet.disconnect(number)


@pytest.mark.parametrize("file", ["racecar/racecar.urdf", "r2d2.urdf", "kuka_iiwa/model.urdf", "pr2_gripper.urdf"])
def test_poses_of_links_agree_with_the_engine_for_all_joint_positions(client: int, file: str) -> None:
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
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "b.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
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


SPHERE = "<geometry><sphere radius='1'/></geometry>"


def pair(*joints: str, links: str = "<link name='a'/><link name='b'/>") -> str:
    return links + "".join(joints)


def joint(name: str, parent: str, child: str, kind: str = "fixed", more: str = "") -> str:
    return f"<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>{more}</joint>"


def shaped(shape: str, kind: str = "collision", more: str = "") -> str:
    return f"<link name='a'><{kind}>{more}<geometry>{shape}</geometry></{kind}></link>"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "describes no robot"),
        ("<link/>", "a link has a name"),
        (f"<link name='{'a' * 300}'/>", "at most 255 characters"),
        ("<link name='a'/><link name='a'/>", "the link `a` is already on line 1"),
        ("<link name='a'/><link name='b'/>", "2 links that no joint carries, its roots.*`a`, `b`"),
        (pair(joint("j", "ghost", "b")), "the parent of the joint `j` is `ghost`"),
        (pair(joint("j", "a", "ghost")), "the child of the joint `j` is `ghost`"),
        (pair("<joint name='j' type='fixed'><parent link='a'/></joint>"), "`j` has one `child`"),
        (pair(joint("j", "a", "b"), joint("j", "a", "b")), "the joint `j` is already on line 1"),
        (pair(joint("j", "a", "b"), joint("k", "a", "b")), "carries the link `b`, as the joint `j` does"),
        (pair(joint("j", "a", "b"), joint("k", "b", "a")), "form a loop"),
        (pair(joint("j", "a", "a"), links="<link name='a'/>"), "form a loop"),
        (pair(joint("j", "a", "b", "hinge")), "the type `hinge`; the types are continuous, fixed"),
        (pair(joint("j", "a", "b", "revolute", "<axis xyz='0 0 0'/>")), "has no direction"),
        (pair(joint("j", "a", "b", "revolute", "<limit lower='-1,5'/>")), "`lower` of `limit`.*with a point"),
        (pair(joint("j", "a", "b", more="<origin xyz='1 2'/>")), "has 2 numbers; it has 3 numbers"),
        (shaped("<box size='1 2'/>"), "has 2 numbers; it has 3 numbers"),
        (shaped("<box size='1 2 3 4'/>"), "has 4 numbers"),
        (shaped("<box size='0,5 1 1'/>"), "`0,5` is no number; numbers are written with a point"),
        (shaped("<box size='${w} 1 1'/>"), "a placeholder of xacro"),
        (shaped("<box size='nan 1 1'/>"), "`nan` is no number"),
        (shaped("<box size='1e400 1 1'/>"), "too large"),
        (shaped("<box/>"), "a `box` has a `size`"),
        (shaped("<sphere radius='-1'/>"), "greater than 0, not -1"),
        (shaped("<sphere radius='-1'/>", "visual"), "greater than 0, not -1"),
        (shaped("<sphere radius='0x2'/>"), "`0x2` is no number"),
        (shaped("<cylinder radius='1'/>"), "a `cylinder` has a `length`"),
        (shaped("<cone/>"), "`cone` is no shape"),
        (shaped(""), "one `geometry` with one shape"),
        (shaped("<sphere radius='1'/><sphere radius='1'/>"), "one `geometry` with one shape"),
        ("<link name='a'><visual/></link>", "one `geometry` with one shape"),
        (shaped("<mesh/>"), "a mesh has a `filename`"),
        (shaped("<mesh filename='$(find r)/a.stl'/>"), "a placeholder of xacro"),
        (shaped("<mesh filename='a.stl' scale='1 2'/>"), "has 2 numbers"),
        (shaped("<mesh filename='a.stl' scale='1 0 1'/>"), "not 0"),
        (shaped("<sphere radius='1'/>", more="<origin rpy='0 x 0'/>"), "`x` is no number"),
        ("<link name='a'><inertial><mass value='1,5'/></inertial></link>", "`1,5` is no number"),
        ("<link name='a'><inertial><inertia ixx='a'/></inertial></link>", "`ixx` of `inertia`"),
        (f"<link name='a'><visual>{SPHERE}<material><color rgba='1 0 0'/></material></visual></link>", "has 3 numbers"),
        ("<link name='a'/><xacro:wheel/>", "expand the file with `xacro` first"),
        ("<link name='a'", "no XML"),
        (f"<link name='a'>{'<b>' * 120}{'</b>' * 120}</link>", "nested more than 100 deep"),
    ],
)
def test_an_invalid_description_is_refused_at_its_place(text: str, said: str) -> None:
    with pytest.raises(AssetError, match=said) as refused:
        RobotDescription(f"<robot name='r'>{text}</robot>".encode())
    assert (refused.value.line, refused.value.column > 0) == (1, True)


def test_common_deviations_from_the_format_are_read() -> None:
    text = """<?xml version="1.0"?>
    <robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="a">
      <visual><origin xyz="1, 2, 3" rpy="0\t0\n0"/>
        <geometry><sphere radius="1."/><material name="grey"/></geometry></visual>
      <visual><geometry><sphere radius="0"/></geometry></visual>
    </link><gazebo><plugin/></gazebo><transmission name="t"/></robot>"""
    (link,) = RobotDescription(text.encode()).articulation({}).links
    assert [visual.size for visual in link.visuals] == [(1.0,), (0.0,)]
    assert link.visuals[0].position == (1, 2, 3)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize(
    "declared",
    [
        "<!DOCTYPE robot [<!ENTITY a 'ha'><!ENTITY b '&a;&a;'>]>",
        "<!DOCTYPE robot [<!ENTITY b SYSTEM 'file:///etc/hostname'>]>",
        "<!DOCTYPE robot SYSTEM 'http://127.0.0.1:9/robot.dtd'>",
        "<!DOCTYPE robot [<!ENTITY % c SYSTEM 'http://127.0.0.1:9/c'>%c;]>",
    ],
)
def test_entities_are_not_expanded_and_nothing_is_fetched(encoding: str, declared: str) -> None:
    text = f"{declared}<robot><link name='&b;'/></robot>"
    with pytest.raises(AssetError, match="document type"):
        RobotDescription(text.encode(encoding))


def test_a_file_with_too_many_elements_is_not_kept() -> None:
    with pytest.raises(AssetError, match="more than 200,000 elements"):
        RobotDescription(b"<robot>" + b"<a/>" * 200_001 + b"</robot>")


def test_a_file_without_end_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "long.urdf"
    with open(path, "wb") as file:
        file.truncate((16 << 20) + 1)
    with pytest.raises(AssetError, match="longer than 16 MiB"):
        RobotDescription.read(path)


SHIPPED = Path(__file__).parents[2] / "plugins" / "symaware-mujoco" / "scenarios" / "robots"


@pytest.mark.parametrize("file", sorted(path.name for path in SHIPPED.glob("*.urdf")))
def test_shipped_robots_load_in_pybullet_with_their_masses_and_limits(file: str) -> None:
    thing = Obstacle.model_validate(
        {"shape": {"urdf": {"file": file, "radius": 1.0}}, "position": [0, 0, 1], "mass": 1}
    )
    environment = PyBulletEnvironment()
    environment.folder = SHIPPED
    environment.initialise([], {"thing": thing}, 1)
    with environment:
        joints = described(file, AssetFolders(SHIPPED)).description.joints()
        client = environment._id
        (body,) = (each for each in range(pybullet.getNumBodies(client)) if pybullet.getNumJoints(each, client))
        links = range(-1, pybullet.getNumJoints(body, client))
        described_mass = sum(
            float(mass.get("value", 0)) for mass in RobotDescription.read(SHIPPED / file).root.iter("mass")
        )
        assert sum(pybullet.getDynamicsInfo(body, link, client)[0] for link in links) == pytest.approx(described_mass)
        for link in range(pybullet.getNumJoints(body, client)):
            info = pybullet.getJointInfo(body, link, client)
            joint = joints.get(info[1].decode())
            if joint is not None and np.isfinite(joint.lower):
                assert info[8:12] == pytest.approx((joint.lower, joint.upper, joint.effort, joint.velocity))
