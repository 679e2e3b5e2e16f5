"""Joints of URDF files in the spatial world move as in the file, on a fixed or a moving base."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import moved, present

from symaware_cli.core import AgentGroup, Entity, Obstacle, WorldError
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.worlds.bullet import engine
from symaware_cli.worlds.spatial import PyBulletEnvironment

GRAVITY = 9.81
#: What the base weighs, so that what swings on it hardly moves it.
HEAVY = 1e4


def link(name: str, mass: float, height: float = 0.0, inertia: float = 1e-3, body: str = "") -> str:
    moments = {"ixx": inertia, "ixy": 0, "ixz": 0, "iyy": inertia, "iyz": 0, "izz": inertia}
    turning = " ".join(f'{name}="{moment}"' for name, moment in moments.items())
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 {height}"/><mass value="{mass}"/><inertia {turning}/>'
        f"</inertial>{body}</link>"
    )


def joint(
    name: str,
    kind: str,
    parent: str,
    child: str,
    place: str = "0 0 0",
    turned: str = "0 0 0",
    axis: str = "0 1 0",
    more: str = "",
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}" rpy="{turned}"/><axis xyz="{axis}"/>{more}</joint>'
    )


BASE = link("base", HEAVY, 0, HEAVY, '<collision><geometry><box size="4 4 0.2"/></geometry></collision>')


def mechanism(folder: Path, *parts: str) -> None:
    (folder / "mechanism.urdf").write_text(f'<robot name="mechanism">{BASE}{"".join(parts)}</robot>')


def world(folder: Path, mass: float | None = None, **parameters: Any) -> PyBulletEnvironment:
    environment = PyBulletEnvironment(PyBulletEnvironment.Parameters(**{"time_step": 0.01, **parameters}))
    environment.folder = Path(folder)
    urdf = {"urdf": {"file": "mechanism.urdf", "radius": 2.0}}
    entity = Obstacle(shape=urdf, position=[0, 0, 0.1], mass=mass)
    nobody = AgentGroup("nobody", ["nobody"], SingleIntegrator(), Entity(), [[99.0, 99.0]])
    environment.initialise([nobody], {"it": entity}, 1)
    return environment


def positions(environment: PyBulletEnvironment, duration: float, name: str = "it") -> NDArray[np.float64]:
    found = []
    for _ in range(round(duration * 1e9 / environment.time_step)):
        environment.step()
        found.append(present(environment.joint_positions(name))[0])
    return np.array(found)


def integrated(
    acceleration: Callable[..., float], start: tuple[float, float], duration: float, parts: int = 100_000
) -> NDArray[np.float64]:
    """The angle over time by the classical Runge-Kutta method, without a physics engine."""
    step, (angle, rate), found = duration / parts, start, []
    for _ in range(parts):
        one = rate, acceleration(angle, rate)
        two = rate + 0.5 * step * one[1], acceleration(angle + 0.5 * step * one[0], rate + 0.5 * step * one[1])
        three = rate + 0.5 * step * two[1], acceleration(angle + 0.5 * step * two[0], rate + 0.5 * step * two[1])
        four = rate + step * three[1], acceleration(angle + step * three[0], rate + step * three[1])
        angle += step / 6 * (one[0] + 2 * two[0] + 2 * three[0] + four[0])
        rate += step / 6 * (one[1] + 2 * two[1] + 2 * three[1] + four[1])
        found.append(angle)
    return np.array(found)


@pytest.mark.parametrize("mass", [None, 1.0], ids=["fixed base", "free base"])
@pytest.mark.parametrize("inertia", [1e-3, 0.7])
@pytest.mark.parametrize(("damping", "friction"), [(0, 0), (0.4, 0), (0, 0.3)])
def test_a_pendulum_swings_according_to_newtons_laws(
    mass: float | None, inertia: float, damping: float, friction: float, tmp_path: Path
) -> None:
    length, start = 1.0, 0.5
    dynamics = f'<dynamics damping="{damping}" friction="{friction}"/>'
    bob = link("bob", 1.0, -length, inertia)
    mechanism(tmp_path, bob, joint("hinge", "continuous", "base", "bob", "0 0 3", f"0 {-start} 0", more=dynamics))
    with world(tmp_path, mass) as environment:
        found = positions(environment, 2.0)[:, 0]

    def acceleration(angle: float, rate: float) -> float:
        brake = damping * rate + (math.copysign(friction, rate) if rate else 0.0)
        return (-GRAVITY * length * math.sin(angle) - brake) / (length**2 + inertia)

    expected = integrated(acceleration, (-start, 0.0), 2.0)[499::500] + start
    if not damping and not friction:
        assert expected.max() == pytest.approx(2 * start, abs=1e-3)
    assert found == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("mass", [None, 1.0], ids=["fixed base", "free base"])
def test_a_sliding_body_falls_by_galileis_law(mass: float | None, tmp_path: Path) -> None:
    limits = '<limit lower="-10" upper="10" effort="1000" velocity="100"/>'
    mechanism(
        tmp_path, link("cart", 2.0), joint("rail", "prismatic", "base", "cart", "0 0 9", axis="0 0 1", more=limits)
    )
    with world(tmp_path, mass) as environment:
        assert positions(environment, 1.0)[-1, 0] == pytest.approx(-0.5 * GRAVITY, rel=5e-3)


def test_two_links_that_swing_on_each_other_keep_their_energy(tmp_path: Path) -> None:
    mechanism(
        tmp_path,
        link("upper", 1.0, -1.0),
        link("lower", 1.0, -1.0),
        joint("shoulder", "continuous", "base", "upper", "0 0 4", "0 1.2 0"),
        joint("elbow", "continuous", "upper", "lower", "0 0 -1", "0 0.6 0"),
    )
    with world(tmp_path, substeps=50) as environment:
        found = positions(environment, 3.0)
    first, second = found[:, 0] + 1.2, found[:, 0] + found[:, 1] + 1.8
    step = 0.01
    one, two = np.gradient(first, step), np.gradient(second, step)
    moving = 0.5 * one**2 + 0.5 * (one**2 + two**2 + 2 * one * two * np.cos(first - second)) + 5e-4 * (one**2 + two**2)
    energy = (moving - GRAVITY * (2 * np.cos(first) + np.cos(second)))[2:-2]
    assert np.ptp(found, axis=0).min() > 1.0
    assert np.ptp(energy) < 0.02 * GRAVITY * 3


def test_links_of_a_robot_with_a_fixed_base_touch_others_and_the_ground(tmp_path: Path) -> None:
    ball = '<collision><origin xyz="0 0 -1"/><geometry><sphere radius="0.2"/></geometry></collision>'
    mechanism(
        tmp_path,
        link("bob", 1.0, -1.0, body=ball),
        joint("hinge", "continuous", "base", "bob", "5 0 0.9", "0 -1.5 0"),
    )
    with world(tmp_path) as environment:
        contacts = moved(environment, 2.0)
    assert {(each.first, each.second) for each in contacts} == {("ground", "it")}
    with world(tmp_path, ground=None) as environment:
        assert np.ptp(positions(environment, 2.0)) == pytest.approx(3.0, abs=0.05)


def test_the_joints_of_a_body_on_a_path_are_held(tmp_path: Path) -> None:
    mechanism(tmp_path, link("bob", 1.0, -1.0), joint("hinge", "continuous", "base", "bob", "0 0 3", "0 -0.5 0"))
    shape = {"urdf": {"file": "mechanism.urdf", "radius": 2.0}}
    environment = PyBulletEnvironment(PyBulletEnvironment.Parameters(time_step=0.01))
    environment.folder = tmp_path
    robot = AgentGroup("robot", ["robot"], SingleIntegrator(), Entity(shape=shape, mass=10.0), [[0.0, 0.0]])
    along = Obstacle(shape=shape, path={"times": [0, 9], "positions": [[0, 9, 1], [9, 9, 1]]})
    environment.initialise([robot], {"along": along}, 1)
    with environment:
        robot.control_input = [[1.0, 0.0]]
        for name in ("robot", "along"):
            assert np.abs(positions(environment, 1.0, name)).max() < 1e-3
        assert environment.state(robot)[0] == pytest.approx([2.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        (
            [link("bob", 0.0), joint("hinge", "continuous", "base", "bob")],
            "no mass to the link that its joint `hinge` moves",
        ),
        (
            [
                *(link(name, 0.0) for name in ("arm", "bob")),
                joint("hinge", "continuous", "base", "arm"),
                joint("weld", "fixed", "arm", "bob"),
            ],
            "no mass to the link that its joint `hinge` moves",
        ),
        *(
            ([link("bob", 1.0), joint("socket", kind, "base", "bob")], f"mechanism.urdf:1:.* `socket` is `{kind}`")
            for kind in ("spherical", "floating", "planar")
        ),
        (
            [
                *(link(name, 1.0) for name in ("one", "other")),
                joint("leader", "continuous", "base", "one"),
                joint("follower", "continuous", "base", "other", more='<mimic joint="nobody"/>'),
            ],
            "mechanism.urdf:1:.* the joint `follower` mimics `nobody`, which is no other joint that moves",
        ),
    ],
)
@pytest.mark.parametrize("mass", [None, 1.0], ids=["fixed base", "free base"])
def test_unsupported_joints_are_refused(parts: list[str], said: str, mass: float | None, tmp_path: Path) -> None:
    mechanism(tmp_path, *parts)
    with pytest.raises(WorldError, match=said) as refused:
        world(tmp_path, mass)
    assert refused.value.path == ("environment", "entities", "it", "shape", "urdf", "file")


@pytest.mark.parametrize("mass", [None, 1.0], ids=["fixed base", "free base"])
def test_joints_follow_those_that_they_mimic(mass: float | None, tmp_path: Path) -> None:
    twice, back = '<mimic joint="leader" multiplier="2" offset="0.3"/>', '<mimic joint="leader" multiplier="-1"/>'
    limits = '<limit lower="-9" upper="9" effort="9" velocity="9"/>'
    mechanism(
        tmp_path,
        link("bob", 1.0, -1.0),
        link("wheel", 0.01),
        link("cart", 0.01),
        joint("leader", "continuous", "base", "bob", "0 0 3", "0 -0.5 0"),
        joint("turns", "continuous", "base", "wheel", more=twice),
        joint("slides", "prismatic", "base", "cart", axis="1 0 0", more=limits + back),
    )
    with world(tmp_path, mass) as environment:
        leader, turns, slides = positions(environment, 1.0).T
    assert np.ptp(leader) > 0.5
    assert turns == pytest.approx(2.0 * leader + 0.3, abs=2e-3)
    assert slides == pytest.approx(-leader, abs=2e-3)


def test_a_link_without_a_mass_may_carry_one_that_has_some(tmp_path: Path) -> None:
    mechanism(
        tmp_path,
        link("hook", 0.0, inertia=0),
        link("bob", 1.0, -1.0),
        joint("hinge", "continuous", "base", "hook", "0 0 3", "0 -0.5 0"),
        joint("weld", "fixed", "hook", "bob"),
    )
    with world(tmp_path) as environment:
        assert positions(environment, 2.0).max() == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize(
    "file", ["pendulum5.urdf", "cartpole.urdf", "TwoJointRobot_w_fixedJoints.urdf", "pr2_gripper.urdf", "r2d2.urdf"]
)
def test_a_mechanism_of_pybullet_moves_as_in_the_engine_alone(file: str, tmp_path: Path) -> None:
    """Beside a plain program of the engine, motors off; files of several kinds that come with it."""
    import pybullet_data

    path = Path(pybullet_data.getDataPath()) / file
    environment = PyBulletEnvironment(PyBulletEnvironment.Parameters(time_step=0.01, ground=None))
    environment.folder = tmp_path
    entity = Obstacle(
        shape={"urdf": {"file": f"pybullet_data/{file}", "radius": 2.0}}, position=[0, 0, 0.1], heading=0.3
    )
    environment.initialise([], {"it": entity}, 1)
    with environment:
        ours = positions(environment, 1.0)[-1]
        names = list(environment.articulations()["it"].joints)
    client = engine.connect(engine.DIRECT)
    engine.setTimeStep(0.001, client)
    engine.setGravity(0, 0, -GRAVITY, client)
    body = engine.loadURDF(
        str(path),
        [0, 0, 0.1],
        [0, 0, math.sin(0.15), math.cos(0.15)],
        useFixedBase=True,
        flags=engine.URDF_USE_INERTIA_FROM_FILE,
        physicsClientId=client,
    )
    where = {}
    for number in range(engine.getNumJoints(body, client)):
        info = engine.getJointInfo(body, number, client)
        where[info[1].decode()] = number
        if info[2] in (engine.JOINT_REVOLUTE, engine.JOINT_PRISMATIC):
            engine.setJointMotorControl2(body, number, engine.VELOCITY_CONTROL, force=info[7], physicsClientId=client)
        engine.changeDynamics(body, number, linearDamping=0, angularDamping=0, physicsClientId=client)
    engine.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    for _ in range(1000):
        engine.stepSimulation(client)
    alone = [engine.getJointState(body, where[name], client)[0] for name in names]
    engine.disconnect(client)
    assert ours == pytest.approx(alone, abs=1e-6)
