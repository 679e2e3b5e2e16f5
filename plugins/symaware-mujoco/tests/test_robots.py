"""Robots from files in MuJoCo: the figures of data sheets, motors within limits, wheels, states, and refusals."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml
from symaware_mujoco.robot import read_robot
from symaware_mujoco.world import MujocoEnvironment

import symaware_cli as sa
from symaware_cli.assets import AssetFolders, asset
from symaware_cli.core import AgentGroup, Entity, Mjcf, Model, Urdf, WorldError
from symaware_cli.engine.models.articulated import ArticulatedRobot
from symaware_cli.engine.models.wheeled import AckermannDrive, DifferentialDrive
from symaware_cli.geometry import about, rotated
from symaware_cli.log.digest import digest

pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")

SCENARIOS = Path(__file__).parents[1] / "scenarios"
ROBOTS = SCENARIOS / "robots"
DEGREE = np.pi / 180
INF = np.inf

#: A rod of 1 kg and 0.6 m on a hinge, whose middle is 0.3 m from the hinge, beside a base of 2 kg; 5 N m at most.
ROD = """<mujoco><compiler angle="radian"/><worldbody><body name="base">
<geom type="box" size=".05 .05 .05" mass="2"/>
<body name="rod" pos="0 .1 0"><joint name="hinge" axis="0 1 0" range="-3 3" actuatorfrcrange="-5 5"/>
<inertial pos="0 0 -.3" mass="1" diaginertia=".03 .03 .001"/><geom type="sphere" pos="0 0 -.3" size=".01"/>
</body></body></worldbody></mujoco>"""
#: [N m] The torque that holds the rod horizontally, and [kg m^2] its inertia about the hinge.
HELD, INERTIA = 0.3 * 9.81, 0.03 + 0.09


def world(
    model: Model, shape: dict[str, Any], states: Sequence[Sequence[float]], folder: Path = ROBOTS, **given: Any
) -> tuple[MujocoEnvironment, AgentGroup]:
    entity = Entity(shape=shape, friction=0.8)
    model.fit(entity, AssetFolders(folder), "agents", "robot")
    rows = np.array(states, float)
    group = AgentGroup("robot", [f"robot.{row}" for row in range(len(rows))], model, entity, rows)
    parameters = {"time_step": 0.02, "substeps": 10, "ground": {"friction": 1.0}, **given}
    environment = MujocoEnvironment(MujocoEnvironment.Parameters.model_validate(parameters))
    environment.folder = folder
    environment.initialise([group], {}, 1)
    return environment, group


def after(environment: MujocoEnvironment, group: AgentGroup, control_input: Any, seconds: float) -> Any:
    """Return the state of the first robot after some time with one control input."""
    group.control_input = np.tile(np.array(control_input, float), (len(group), 1))
    for _ in range(round(seconds / 0.02)):
        environment.step()
    return environment.state(group)[0]


def rod(folder: Path, **parameters: Any) -> tuple[MujocoEnvironment, AgentGroup]:
    (folder / "rod.xml").write_text(ROD)
    model = ArticulatedRobot(ArticulatedRobot.Parameters(joints=("hinge",), **parameters))
    return world(model, {"mjcf": {"file": "rod.xml", "radius": 0.5}}, [[0, 0, 1, 0, 0, 0]], folder)


# -- data sheets


ARM = (-360 * DEGREE, 360 * DEGREE)
GO1 = {"hip": (-0.863, 0.863, 23.7, 30.1), "thigh": (-0.686, 4.501, 23.7, 30.1), "calf": (-2.818, -0.888, 35.55, 20.06)}
PANDA = [
    *((-2.8973, 2.8973), (-1.7628, 1.7628), (-2.8973, 2.8973), (-3.0718, -0.0698)),
    *((-2.8973, 2.8973), (-0.0175, 3.7525), (-2.8973, 2.8973)),
]
GEN3 = [INF, 128.9 * DEGREE, INF, 147.8 * DEGREE, INF, 120.3 * DEGREE, INF]
UR = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")

#: For each file the mass [kg], and for its joints the least and greatest position, the effort and the velocity.
SHEETS: dict[str, tuple[float, dict[str, tuple[float, float, float, float]]]] = {
    "turtlebot3_burger.urdf": (
        1.0,
        {f"{side}_wheel_joint": (-INF, INF, 1.4, 0.22 / 0.033) for side in ("left", "right")},
    ),
    "f1tenth.urdf": (3.74, {f"{side}_steering_joint": (-0.4189, 0.4189, 5.0, 3.2) for side in ("left", "right")}),
    "husky.urdf": (50.0, {f"{end}_left_joint": (-INF, INF, 60.0, 1.0 / 0.165) for end in ("front", "rear")}),
    "ur5e.urdf": (
        20.6,
        {f"{name}_joint": (*ARM, 150.0 if number < 3 else 28.0, np.pi) for number, name in enumerate(UR)},
    ),
    "ur3e.urdf": (
        11.2,
        {
            f"{name}_joint": (*ARM, [56, 56, 28, 12, 12, 12][number], (1 if number < 3 else 2) * np.pi)
            for number, name in enumerate(UR)
        },
    ),
    "kinova_gen3.urdf": (
        8.2,
        {
            f"joint_{number + 1}": (-most, most, 39.0 if number < 4 else 9.0, (79.64 if number < 4 else 69.91) * DEGREE)
            for number, most in enumerate(GEN3)
        },
    ),
    "panda.xml": (
        18.0,
        {f"joint{number + 1}": (*most, 87.0 if number < 4 else 12.0, INF) for number, most in enumerate(PANDA)},
    ),
    "robotiq_2f85.xml": (0.9, {"left_finger_joint": (0.0, 0.0425, 235.0, INF)}),
    "crazyflie.xml": (0.027, {"rotor1_joint": (-INF, INF, INF, INF)}),
    "go1.urdf": (
        12.0,
        {f"{leg}_{part}_joint": limits for leg in ("FL", "FR", "RL", "RR") for part, limits in GO1.items()},
    ),
}


def specification(file: str) -> Any:
    kind = Urdf if file.endswith(".urdf") else Mjcf
    return read_robot(kind(file=file, radius=1.0), AssetFolders(ROBOTS))


@pytest.mark.parametrize("file", SHEETS)
def test_mass_and_limits_of_a_robot_are_those_of_its_data_sheet(file: str) -> None:
    mass, limits = SHEETS[file]
    model = specification(file).compile()
    joints = asset.described(file, AssetFolders(ROBOTS)).description.joints()
    assert model.body_mass.sum() == pytest.approx(mass, rel=1e-9)
    for name, (lower, upper, effort, velocity) in limits.items():
        joint = joints[name]
        assert (joint.lower, joint.upper) == pytest.approx((lower, upper), rel=1e-5)
        assert (joint.effort, joint.velocity) == pytest.approx((effort, velocity), rel=1e-5)
        if np.isfinite(lower):
            assert model.joint(name).range == pytest.approx((lower, upper), rel=1e-5)
        else:
            assert not model.jnt_limited[model.joint(name).id]


def test_every_robot_that_is_shipped_is_compared() -> None:
    assert sorted(SHEETS) == sorted(each.name for each in ROBOTS.iterdir())


@pytest.mark.parametrize("file", SHEETS)
def test_our_kinematics_puts_links_where_the_engine_has_them(file: str) -> None:
    model = specification(file).compile()
    data, robot = mujoco.MjData(model), asset.described(file, AssetFolders(ROBOTS))
    described = robot.description.articulation(robot.paths)
    positions = np.random.default_rng(3).uniform(-1.0, 1.0, len(described.joints))
    for name, position in zip(described.joints, positions, strict=True):
        data.qpos[model.joint(name).qposadr[0]] = position
    mujoco.mj_kinematics(model, data)
    places, turned = described.frames(positions)
    for link, place, orientation in zip(described.links, places, turned, strict=True):
        body = data.body(link.name)
        assert body.xpos == pytest.approx(place, abs=1e-12)
        assert abs(np.roll(body.xquat, -1) @ orientation) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("model", "file", "state", "control_input", "tolerance"),
    [
        (
            ArticulatedRobot(ArticulatedRobot.Parameters(joints=("shoulder_pan_joint", "elbow_joint"))),
            "ur5e.urdf",
            [0.3, -0.2, 0.5, 0.7, 0.1, 0.4, 0.0, 0.0],
            [0.5, -0.4],
            1e-9,
        ),
        # The robot is supported by a ball at the rear, and pitches by a thousandth of a radian while it drives.
        (
            DifferentialDrive(
                DifferentialDrive.Parameters(left=("left_wheel_joint",), right=("right_wheel_joint",), max_speed=0.2)
            ),
            "turtlebot3_burger.urdf",
            [0.3, -0.2, 0.7, 0.0, 0.0],
            [0.15, 1.0],
            1e-3,
        ),
        (
            AckermannDrive(
                AckermannDrive.Parameters(
                    driven=("rear_left_joint", "rear_right_joint"),
                    steered=("left_steering_joint", "right_steering_joint"),
                )
            ),
            "f1tenth.urdf",
            [0.3, -0.2, 0.7, 0.0, 0.0],
            [0.5, 0.3],
            1e-3,
        ),
    ],
    ids=["arm", "differential", "car"],
)
def test_links_are_where_the_engine_moves_them(
    model: Model, file: str, state: list[float], control_input: list[float], tolerance: float
) -> None:
    environment, group = world(model, {"urdf": {"file": file, "radius": 0.1}}, [state])
    moved = after(environment, group, control_input, 0.5)
    assert np.abs(moved - state).max() > 0.05
    described, joints = environment.articulations()["robot"], environment.joint_positions("robot")
    poses = environment.body_poses("robot")
    assert model.links is not None
    assert joints is not None
    pose = np.array([*moved[:3], *about((0, 0, 1), moved[3])]) if poses is None else poses[0]
    outer = pose[:3] + rotated(pose[3:], described.frames(joints[0])[0])
    for link, place in zip(described.links, outer, strict=True):
        if link.name in model.links.names:
            found = model.links.positions(moved[None], link.name)[0]
            assert found == pytest.approx(place[: len(found)], abs=tolerance)
        else:
            assert link.name in model.links.unknown


# -- motors


def test_a_joint_has_the_velocity_that_it_is_given_against_gravity(tmp_path: Path) -> None:
    environment, group = rod(tmp_path)
    state = after(environment, group, [-0.5], 1.0)
    assert state[4:] == pytest.approx([-0.5, -0.5], abs=0.003)


def test_a_motor_holds_loads_up_to_its_effort(tmp_path: Path) -> None:
    strong, group = rod(tmp_path, drive="position")
    assert after(strong, group, [-np.pi / 2], 2.0)[4] == pytest.approx(-np.pi / 2, abs=1e-4)
    weak, group = rod(tmp_path, drive="position", max_effort=0.5 * HELD)
    # The torque at rest is HELD sin(angle), so that half of it holds 30 degrees; it overshoots and swings about that.
    furthest = max(abs(after(weak, group, [-np.pi / 2], 0.02)[4]) for _ in range(300))
    assert furthest < 75 * DEGREE


def test_a_torque_accelerates_by_the_inertia_and_balances_the_weight(tmp_path: Path) -> None:
    environment, group = rod(tmp_path, drive="torque")
    assert after(environment, group, [-1.0], 0.04)[5] == pytest.approx(-0.04 / INERTIA, rel=0.02)
    (tmp_path / "held").mkdir()
    environment, group = rod(tmp_path / "held", drive="torque")
    horizontal = np.array([[0, 0, 1, 0, -np.pi / 2, 0]])
    (tmp_path / "rod.xml").write_text(ROD)
    environment, group = world(group.model, {"mjcf": {"file": "rod.xml", "radius": 0.5}}, horizontal.tolist(), tmp_path)
    assert after(environment, group, [-HELD], 0.5)[4:] == pytest.approx([-np.pi / 2, 0.0], abs=1e-6)


def test_a_joint_stops_at_the_limit_of_the_file(tmp_path: Path) -> None:
    environment, group = rod(tmp_path)
    assert after(environment, group, [2.0], 3.0)[4] == pytest.approx(3.0, abs=0.05)


def test_velocities_and_efforts_have_the_limits_of_the_file(tmp_path: Path) -> None:
    _, group = rod(tmp_path, drive="torque")
    assert group.model.limit(np.array([[99.0]])) == pytest.approx(np.array([[5.0]]))
    _, group = rod(tmp_path, drive="position")
    assert group.model.limit(np.array([[-99.0]])) == pytest.approx(np.array([[-3.0]]))


def test_an_arm_of_a_data_sheet_goes_to_a_posture_within_its_speed() -> None:
    joints = tuple(f"{name}_joint" for name in UR)
    model = ArticulatedRobot(ArticulatedRobot.Parameters(joints=joints, drive="position"))
    start = [0, 0, 0, 0, 0, -1.5, 0, -1.5, 0, 0, *[0] * 6]
    environment, group = world(model, {"urdf": {"file": "ur5e.urdf", "radius": 1}}, [start])
    goal, fastest = [1.0, -1.0, 1.2, -0.5, 0.7, 2.0], 0.0
    for _ in range(100):
        fastest = max(fastest, float(np.abs(after(environment, group, goal, 0.02)[10:]).max()))
    assert environment.state(group)[0, 4:10] == pytest.approx(goal, abs=1e-4)
    assert fastest < np.pi * 1.01


def test_a_free_robot_stands_on_its_motors() -> None:
    joints = [f"{leg}_{part}_joint" for leg in ("FL", "FR", "RL", "RR") for part in ("hip", "thigh", "calf")]
    model = ArticulatedRobot(ArticulatedRobot.Parameters(joints=tuple(joints), drive="position", base="free"))
    posture = [0.0, 0.8, -1.6] * 4
    # The thigh of 0.213 m and the calf of the same length make the legs 2 * 0.213 cos(0.8) long, with feet of 0.02 m.
    height = 2 * 0.213 * np.cos(0.8) + 0.02
    environment, group = world(
        model, {"urdf": {"file": "go1.urdf", "radius": 0.4}}, [[0, 0, height, *[0.0] * 9, *posture, *[0.0] * 12]]
    )
    state = after(environment, group, posture, 2.0)
    assert state[2] == pytest.approx(height, abs=0.005)
    assert state[3:5] == pytest.approx([0.0, 0.0], abs=0.03)
    assert state[12:24] == pytest.approx(posture, abs=0.02)
    assert environment.body_poses("robot") is None  # the state has the attitude


# -- wheels


def turtlebot(**given: Any) -> DifferentialDrive:
    wheels = {"left": ("left_wheel_joint",), "right": ("right_wheel_joint",)}
    return DifferentialDrive(DifferentialDrive.Parameters(max_speed=0.22, max_turn_rate=2.84, **wheels, **given))


BURGER = {"urdf": {"file": "turtlebot3_burger.urdf", "radius": 0.105}}


def test_a_differential_drive_goes_straight_and_turns_as_commanded() -> None:
    environment, group = world(turtlebot(), BURGER, [[1, 2, 0.5, 0, 0]])
    x, y, heading, speed, _ = after(environment, group, [0.2, 0.0], 2.0)
    assert (x, y) == pytest.approx((1 + 0.4 * np.cos(0.5), 2 + 0.4 * np.sin(0.5)), abs=0.012)
    assert (heading, speed) == pytest.approx((0.5, 0.2), abs=0.005)
    state = after(environment, group, [0.0, 1.0], 2.0)
    assert state[2] == pytest.approx(2.5, rel=0.03)
    assert state[:2] == pytest.approx([x, y], abs=0.02)


def test_a_differential_drive_begins_with_the_speed_of_its_state_on_rolling_wheels() -> None:
    environment, group = world(turtlebot(), BURGER, [[0, 0, 0, 0.2, 0]])
    x, *_ = after(environment, group, [0.2, 0.0], 0.5)
    assert x == pytest.approx(0.1, abs=0.002)


def test_no_wheel_turns_faster_than_its_motor() -> None:
    model = DifferentialDrive(
        DifferentialDrive.Parameters(left=("left_wheel_joint",), right=("right_wheel_joint",), max_speed=5.0)
    )
    _, group = world(model, BURGER, [[0, 0, 0, 0, 0]])
    assert group.model.limit(np.array([[5.0, 0.0]]))[0, 0] == pytest.approx(0.22, rel=1e-5)


def test_a_car_turns_on_the_circle_of_its_steering_angle() -> None:
    model = AckermannDrive(
        AckermannDrive.Parameters(
            driven=("rear_left_joint", "rear_right_joint"),
            steered=("left_steering_joint", "right_steering_joint"),
            max_speed=3.0,
        )
    )
    environment, group = world(model, {"urdf": {"file": "f1tenth.urdf", "radius": 0.3}}, [[0, 0, 0, 1.0, 0.2]])
    before = after(environment, group, [1.0, 0.2], 0.5)
    state = after(environment, group, [1.0, 0.2], 2.0)
    assert state[3:] == pytest.approx([1.0, 0.2], abs=0.02)
    # The wheelbase of F1TENTH is 0.3302 m; tyres slip a little.
    assert (state[2] - before[2]) / 2.0 == pytest.approx(np.tan(0.2) / 0.3302, rel=0.03)


def test_four_wheels_slip_where_they_turn() -> None:
    wheels = {side: tuple(f"{end}_{side}_joint" for end in ("front", "rear")) for side in ("left", "right")}
    model = DifferentialDrive(DifferentialDrive.Parameters.model_validate(wheels))
    environment, group = world(model, {"urdf": {"file": "husky.urdf", "radius": 0.6}}, [[0, 0, 0, 0, 0]])
    state = after(environment, group, [0.5, 0.5], 2.0)
    assert state[0] == pytest.approx(0.97, abs=0.05)
    assert 0.1 < state[2] < 0.9


# -- scenarios


@pytest.mark.parametrize("name", ["reaching", "differential"])
def test_a_scenario_with_motors_repeats_and_its_log_verifies_without_the_files(name: str, tmp_path: Path) -> None:
    shutil.copytree(ROBOTS, tmp_path / "robots")
    (tmp_path / "s.yaml").write_text((SCENARIOS / f"{name}.yaml").read_text())
    scenario = sa.load(tmp_path / "s.yaml", ["run.duration=1", "specifications={}"])
    scenario.run(output=tmp_path / "one.mcap")
    shutil.rmtree(tmp_path / "robots")
    assert sa.verify_log(str(tmp_path / "one.mcap")).is_equal
    assert any("joint" in topic for topic in sa.open_log(tmp_path / "one.mcap").channels)


@pytest.mark.parametrize("step", [0, 13, 60])
def test_a_run_with_motors_continues_from_its_state_to_the_same_bytes(step: int, tmp_path: Path) -> None:
    scenario = sa.load(SCENARIOS / "differential.yaml")
    with scenario.start(output=tmp_path / "whole.mcap") as simulation:
        simulation.step(step + 20)
    with scenario.start(output=tmp_path / "again.mcap") as simulation:
        if step:
            simulation.step(step)
        state = sa.SimulationState.from_bytes(simulation.capture().to_bytes())
        simulation.step(9)
        simulation.restore(state)
        simulation.step(20)
    one, two = (digest(sa.open_log(tmp_path / f"{name}.mcap")).channels for name in ("whole", "again"))
    assert one == two


def drive(folder: Path, changes: Sequence[str] = ()) -> sa.Scenario:
    """A run of one TurtleBot that drives to a goal."""
    scenario = yaml.safe_load((SCENARIOS / "differential.yaml").read_text())
    scenario["agents"]["robot"] |= {"count": 1, "state": {"each": [[0, 0, 0, 0, 0]]}}
    scenario["agents"]["robot"]["knowledge"] = {"goal": [1.0, 0.5]}
    scenario["specifications"].pop("crate-is-pushed")
    scenario["environment"]["entities"] = {}
    if not (folder / "robots").exists():
        shutil.copytree(ROBOTS, folder / "robots")
    (folder / "s.yaml").write_text(yaml.safe_dump(scenario))
    return sa.load(folder / "s.yaml", list(changes))


@pytest.mark.parametrize("use", ["mujoco", "kinematic"])
def test_a_controller_of_unicycles_drives_it_in_every_world_that_can(use: str, tmp_path: Path) -> None:
    changes = [] if use == "mujoco" else ["environment.use=kinematic", "environment.with={time_step: 0.02}"]
    result = drive(tmp_path, [*changes, "run.duration=8"]).run(record=False)
    assert result.summary.goals_reached == ("robot.0",)


WHEELS = "agents.robot.model.with"
TORQUE = "{joints: [left_wheel_joint], drive: torque}"
BODY = "{shape: {urdf: {file: robots/turtlebot3_burger.urdf, radius: 0.1}}}"


@pytest.mark.parametrize(
    ("change", "place", "said"),
    [
        ("environment={use: pybullet}", "agents.robot.model", "no motors for the joints.*`mujoco`"),
        ("environment={use: pymunk}", "agents.robot.model", "no motors for the joints.*`mujoco`"),
        ("agents.robot.entity={shape: {circle: {radius: 0.1}}}", "agents.robot.entity", "give the body a `shape`"),
        (f"{WHEELS}.left=[wheel]", f"{WHEELS}.left", "has no joint `wheel` that moves; it has `left_wheel_joint`"),
        (f"{WHEELS}.left=[right_wheel_joint]", f"{WHEELS}.left", "not to the left of those on the right"),
        (f"{WHEELS}.left=[caster_turn]", f"{WHEELS}.left", "does not turn a wheel about the robot's y axis"),
        (
            "environment={use: mujoco, with: {ground: null}}",
            "environment.with.ground",
            "drive on the ground, and there is none",
        ),
        (
            f"agents.robot={{model: {{use: articulated, with: {TORQUE}}}, state: [0, 0, 0, 0, 0, 0], entity: {BODY}}}",
            "agents.robot.model",
            "needs a world with mechanisms.*`mujoco`",
        ),
    ],
)
def test_impossible_robots_are_refused_at_their_place(change: str, place: str, said: str, tmp_path: Path) -> None:
    changes = [change]
    if "torque" in change:
        changes += ["environment={use: kinematic}", "specifications={}"]
    with pytest.raises(sa.ScenarioError, match=f"(?s){said}") as refused:
        drive(tmp_path, changes)
    assert any(problem.path.startswith(place) for problem in refused.value.problems)


def test_robots_with_motors_cannot_be_displaced() -> None:
    environment, group = world(turtlebot(), BURGER, [[0, 0, 0, 0, 0]])
    with pytest.raises(NotImplementedError, match="cannot be displaced"):
        environment.push(group, [0], np.zeros(5))


def test_a_model_without_its_body_is_refused() -> None:
    with pytest.raises(WorldError, match="tells the model its body first"):
        turtlebot().mechanism()


def test_rays_pass_through_all_links_of_the_robot_that_casts_them() -> None:
    environment, _ = world(turtlebot(), BURGER, [[0, 0, 0, 0, 0], [1, 0, 0, 0, 0]])
    turns = np.linspace(-np.pi, np.pi, 37)
    directions = np.stack([np.cos(turns), np.sin(turns)], axis=-1)[None]
    (distances,) = environment.ray_cast(np.array([0]), np.zeros((1, 2)), directions, 5.0, 0.05)
    assert distances[18] == pytest.approx(1.0 - 0.101, abs=0.01)
    assert np.isinf(distances[:9]).all()
