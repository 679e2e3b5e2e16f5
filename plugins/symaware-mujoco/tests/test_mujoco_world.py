"""Rigid bodies in MuJoCo: closed forms, contacts, exact repetition, and captured and restored states."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from symaware_mujoco.bounce import damping_ratio, rebound
from symaware_mujoco.world import MujocoEnvironment

import symaware_cli as sa
from symaware_cli.core import AgentGroup, Entity, Obstacle
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.log.digest import digest
from symaware_cli.testing import check_environment

pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")

SCENARIOS = Path(__file__).parents[1] / "scenarios"
BALL = {"circle": {"radius": 0.1}}
CRATE = {"box": {"length": 0.4, "width": 0.4, "height": 0.4}}
FREE: dict[str, Any] = {"gravity": (0.0, 0.0, 0.0), "ground": None}


#: A rod on a base: a pendulum of 1 kg whose middle is 0.3 m below its hinge.
URDF = """<robot name="pendulum">
<link name="base"><inertial><mass value="2"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size=".2 .2 .2"/></geometry></collision></link>
<link name="rod"><inertial><origin xyz="0 0 -.3"/><mass value="1"/>
<inertia ixx=".01" iyy=".01" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 -.3"/><geometry><mesh filename="rod.obj"/></geometry></collision></link>
<joint name="hinge" type="{kind}"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="10" velocity="50"/></joint></robot>"""
TENT = "v -.02 0 -.2\nv .02 0 -.2\nv 0 .02 -.2\nv 0 0 .2\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def robot_file(folder: Path, kind: str = "continuous") -> dict[str, Any]:
    (folder / "pendulum.urdf").write_text(URDF.format(kind=kind))
    (folder / "rod.obj").write_text(TENT)
    return {"urdf": {"file": "pendulum.urdf", "radius": 1.0}}


def world(
    entities: dict[str, Obstacle] | None = None,
    groups: list[AgentGroup] | None = None,
    folder: Path = Path(),
    **given: Any,
) -> MujocoEnvironment:
    parameters = {"time_step": 0.02, "substeps": 20, **given}
    environment = MujocoEnvironment(MujocoEnvironment.Parameters.model_validate(parameters))
    environment.folder = folder
    environment.initialise(groups or [robots([[99.0, 99.0]])], entities or {}, 1)
    return environment


def robots(states: Any, **entity: Any) -> AgentGroup:
    from symaware_cli.engine.models.integrator import SingleIntegrator

    rows = np.array(states, float)
    ids = [f"robot.{row}" for row in range(len(rows))]
    body = Entity(**{"shape": BALL, **entity})
    return AgentGroup("robot", ids, SingleIntegrator(SingleIntegrator.Parameters(max_speed=100.0)), body, rows)


def after(environment: MujocoEnvironment, seconds: float) -> MujocoEnvironment:
    for _ in range(round(seconds / 0.02)):
        environment.step()
    return environment


# -- closed forms


@pytest.mark.parametrize("elasticity", [0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0])
def test_the_damping_of_a_contact_gives_its_elasticity(elasticity: float) -> None:
    assert rebound(damping_ratio(elasticity)) == pytest.approx(elasticity, abs=0.03)


@pytest.mark.parametrize("elasticity", [0.0, 0.2, 0.3, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("height", [0.3, 1.0, 3.0])
def test_a_ball_bounces_as_high_as_its_elasticity_squared(elasticity: float, height: float) -> None:
    ball = Obstacle(shape=BALL, position=[0, 0, height + 0.1], mass=1.0, elasticity=elasticity)
    environment, heights = world({"ball": ball}), []
    fall = np.sqrt(2 * height / 9.81)
    for _ in range(round(2.2 * fall / 0.02)):
        environment.step()
        heights.append(environment.pose("ball").position[2] - 0.1)
    peak = max(heights[round(1.1 * fall / 0.02) :])
    assert np.sqrt(max(peak, 0.0) / height) == pytest.approx(elasticity, abs=0.06)


@pytest.mark.parametrize(("masses", "elasticity"), [((1.0, 1.0), 1.0), ((1.0, 3.0), 0.5), ((2.0, 1.0), 0.0)])
def test_a_collision_keeps_momentum_and_the_elastic_part_of_the_speed(
    masses: tuple[float, float], elasticity: float
) -> None:
    surface = {"elasticity": float(np.sqrt(elasticity))}
    one = Obstacle(shape=BALL, position=[0, 0, 0], velocity=[2.0, 0, 0], mass=masses[0], **surface)
    other = Obstacle(shape=BALL, position=[1, 0, 0], mass=masses[1], **surface)
    environment = after(world({"a": one, "b": other}, **FREE), 1.5)
    first, second = (environment.pose(name).velocity[0] for name in "ab")
    assert masses[0] * first + masses[1] * second == pytest.approx(2.0 * masses[0], abs=1e-9)
    assert second - first == pytest.approx(2.0 * elasticity, abs=0.12)


@pytest.mark.parametrize(("floor", "own"), [(1.0, 0.3), (0.5, 0.6), (0.2, 2.0)])
def test_the_product_of_both_frictions_determines_how_far_a_crate_slides(floor: float, own: float) -> None:
    crate = Obstacle(shape=CRATE, position=[0, 0], velocity=[2.0, 0.0], mass=5.0, friction=own)
    environment = after(world({"crate": crate}, ground={"friction": floor, "elasticity": 0.0}), 2.0)
    # v^2 / (2 mu g)
    assert environment.pose("crate").position[0] == pytest.approx(4.0 / (2 * floor * own * 9.81), rel=0.02)
    assert environment.pose("crate").velocity[0] == pytest.approx(0.0, abs=1e-3)


def test_standing_bodies_do_not_creep_or_sink() -> None:
    stack = {
        name: Obstacle(shape=CRATE, position=[0, 0, 0.2 + 0.4 * number], mass=1.0, elasticity=0.0)
        for number, name in enumerate("abc")
    }
    environment = after(world(stack), 5.0)
    for number, name in enumerate("abc"):
        assert environment.pose(name).position == pytest.approx((0, 0, 0.2 + 0.4 * number), abs=2e-3)


def test_free_flight_is_a_parabola_and_damping_reduces_its_speed() -> None:
    ball = Obstacle(shape=BALL, position=[0, 0, 10], velocity=[1.0, 0.0, 2.0], mass=1.0)
    x, _, z = after(world({"ball": ball}), 1.0).pose("ball").position
    assert (x, z) == pytest.approx((1.0, 10 + 2.0 - 0.5 * 9.81), abs=0.006)
    slower = after(world({"ball": ball}, damping=0.3, **FREE), 1.0)
    assert slower.pose("ball").velocity[0] == pytest.approx(0.7, abs=1e-9)


def test_a_torque_free_body_keeps_its_turn_rate_and_counts_as_free() -> None:
    crate = Obstacle(shape=CRATE, position=[0, 0, 5], turn_rate=1.5, mass=1.0)
    environment = after(world({"crate": crate}, **FREE), 2.0)
    assert environment.pose("crate").turn_rate == pytest.approx(1.5, abs=1e-9)
    assert environment.pose("crate").heading == pytest.approx(3.0, abs=1e-6)
    assert environment.moves("crate")


# -- agents


def test_an_agent_goes_where_its_model_goes_until_something_is_in_its_way() -> None:
    group = robots([[0.0, 0.0]], max_force=2000.0)
    wall = Obstacle(shape={"wall": {"points": [[1, -1], [1, 1]], "thickness": 0.1}}, position=[0, 0])
    environment = world({"wall": wall}, [group])
    group.control_input = np.array([[1.0, 0.5]])
    after(environment, 0.4)
    assert environment.state(group)[0] == pytest.approx([0.4, 0.2], abs=0.005)
    after(environment, 1.6)
    x, y = environment.state(group)[0]
    assert x == pytest.approx(0.85, abs=0.01)
    assert y > 0.2


def test_forces_and_torques_accelerate_bodies_by_their_mass_and_inertia() -> None:
    group = robots([[0.0, 0.0]], mass=4.0, max_force=2.0)
    environment = world(groups=[group])
    group.control_input = np.array([[10.0, 0.0]])
    after(environment, 1.0)
    assert environment.snapshot().velocities[0] == pytest.approx([0.5, 0.0], rel=1e-6)
    # A ball of 0.1 m: I = 2/5 m r^2
    body = Entity(shape=BALL, mass=4.0, max_torque=0.008)
    turning = AgentGroup("cart", ["cart"], Unicycle(Unicycle.Parameters(max_turn_rate=9.0)), body, np.zeros((1, 3)))
    environment = world(groups=[turning])
    turning.control_input = np.array([[0.0, 9.0]])
    after(environment, 1.0)
    assert environment.state(turning)[0, 2] == pytest.approx(0.5 * 0.008 / (0.4 * 4.0 * 0.01), rel=2e-3)
    pushed = AgentGroup("puck", ["puck"], DoubleIntegrator(), Entity(shape=BALL), np.zeros((1, 4)))
    environment = world(groups=[pushed])
    pushed.control_input = np.array([[1.0, 0.0]])
    after(environment, 1.0)
    assert environment.state(pushed)[0] == pytest.approx([0.5, 0.0, 1.0, 0.0], abs=1e-3)


def test_the_force_of_a_robot_decides_what_it_can_push() -> None:
    result = sa.load(SCENARIOS / "pushing.yaml").run(record=False)
    assert [each.verdict for each in result.summary.specifications] == ["satisfied", "satisfied"]


def test_contacts_begin_once_and_have_the_impulse_that_stopped_the_body() -> None:
    ball = Obstacle(shape=BALL, position=[0, 0, 1.1], mass=2.0, elasticity=0.0)
    environment = world({"ball": ball})
    contacts: list[sa.Contact] = []
    for _ in range(100):
        environment.step()
        contacts += environment.contacts()
    (contact,) = contacts
    assert (contact.first, contact.second, contact.begins) == ("ball", "ground", True)
    assert contact.impulse == pytest.approx(2.0 * np.sqrt(2 * 9.81), rel=0.15)


def test_an_entity_may_be_called_as_the_engine_calls_its_own() -> None:
    environment = world({"world": Obstacle(shape=CRATE, position=[0, 0], mass=1.0)})
    assert after(environment, 0.2).pose("world").position[2] == pytest.approx(0.2, abs=1e-3)


def test_all_problems_are_reported_at_once(tmp_path: Path) -> None:
    flat = {"mesh": {"file": "none.obj", "radius": 1.0}}
    entities = {name: Obstacle(shape=flat, position=[0, 0]) for name in ("one", "two")}
    with pytest.raises(sa.WorldError) as caught:
        world(entities, folder=tmp_path)
    assert len(caught.value.others) == 1


def test_standing_bodies_have_no_contact_at_the_start_and_overlapping_ones_do() -> None:
    standing = world({"crate": Obstacle(shape=CRATE, position=[0, 0], mass=1.0)})
    assert standing.contacts() == []
    assert after(standing, 0.5).contacts() == []
    overlapping = world(
        {name: Obstacle(shape=BALL, position=[0.05 * n, 0, 1], mass=1.0) for n, name in enumerate("ab")}
    )
    (contact,) = overlapping.contacts()
    assert (contact.first, contact.second) == ("a", "b")
    assert contact.depth == pytest.approx(0.15, abs=1e-6)


def test_an_absent_agent_does_not_block_others() -> None:
    scenario = yaml.safe_load((SCENARIOS / "pushing.yaml").read_text())
    robot = scenario["agents"]["robot"]
    scenario["agents"]["ghost"] = {
        **robot,
        "count": 1,
        "state": [[0.6, 2.0]],
        "knowledge": {"goal": {"all": [0.6, 2.0]}},
        "present": {"from": 5.0},
    }
    result = sa.scenario(scenario).run(record=False)
    assert result.summary.specifications[0].verdict == "satisfied"


def test_rays_end_at_bodies_and_pass_through_the_one_that_casts_them() -> None:
    group = robots([[0.0, 0.0], [2.0, 0.0]])
    environment = world({"crate": Obstacle(shape=CRATE, position=[0.0, 3.0])}, [group])
    directions = np.array([[[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]]])
    (found,) = environment.ray_cast(np.array([0]), np.zeros((1, 2)), directions, 10.0)
    assert found[:2] == pytest.approx([1.9, 2.8], abs=1e-3)
    assert np.isinf(found[2])


def test_a_mesh_stands_on_the_ground(tmp_path: Path) -> None:
    (tmp_path / "tent.obj").write_text("v 0 0 2\nv 1 0 2\nv 0 1 2\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    tent = Obstacle(shape={"mesh": {"file": "tent.obj", "radius": 1.0, "scale": 0.5}}, position=[0, 0], mass=3.0)
    environment = world({"tent": tent}, folder=tmp_path)
    assert environment.pose("tent").position == pytest.approx((0, 0, -1.0))
    after(environment, 1.0)
    assert environment.pose("tent").position == pytest.approx((0, 0, -1.0), abs=1e-3)


def test_a_pendulum_from_a_file_swings_with_the_period_of_the_formula(tmp_path: Path) -> None:
    pendulum = Obstacle(shape=robot_file(tmp_path), position=[0, 0, 2.0], pitch=0.1)
    environment, angles = world({"pendulum": pendulum}, folder=tmp_path), []
    for _ in range(200):
        environment.step()
        joints = environment.joint_positions("pendulum")
        assert joints is not None
        angles.append(float(joints[0, 0]) + 0.1)
    crossings = np.flatnonzero(np.diff(np.sign(angles)))
    period = 2 * np.mean(np.diff(crossings)) * 0.02
    # 2 pi sqrt(I / (m g l)), with I about the hinge
    assert period == pytest.approx(2 * np.pi * np.sqrt((0.01 + 0.09) / (9.81 * 0.3)), rel=0.02)


def test_a_free_robot_stands_on_the_ground_and_its_links_pass_through_each_other(tmp_path: Path) -> None:
    robot = Obstacle(shape=robot_file(tmp_path), position=[1, 2], mass=1.0)
    environment = world({"mobile": robot}, folder=tmp_path)
    assert environment.pose("mobile").position == pytest.approx((1, 2, 0.5))
    after(environment, 3.0)
    poses = environment.body_poses("mobile")
    assert poses is not None
    assert np.isfinite(poses).all()
    assert 0.0 < poses[0, 2] < 0.5


def test_joints_are_in_the_log_which_repeats_without_the_files(tmp_path: Path) -> None:
    scenario = {
        "symaware": 1,
        "name": "pendulum",
        "run": {"duration": 1.0},
        "environment": {
            "use": "mujoco",
            "with": {"time_step": 0.05},
            "entities": {"pendulum": {"shape": robot_file(tmp_path), "position": [0, 0, 2.0], "pitch": 0.5}},
        },
        "agents": {"robot": {"model": {"use": "single-integrator"}, "state": [5, 5]}},
    }
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(scenario))
    sa.load(tmp_path / "s.yaml").run(output=tmp_path / "log.mcap")
    for name in ("pendulum.urdf", "rod.obj"):
        (tmp_path / name).unlink()
    assert sa.verify_log(str(tmp_path / "log.mcap")).is_equal
    topics = [topic for topic in sa.open_log(tmp_path / "log.mcap").channels if "joint" in topic]
    assert len(topics) == 1


ODD = """<robot name="odd"><link name="base"><inertial><mass value="5"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
<visual><geometry><mesh filename="package://odd/lost.stl"/></geometry></visual></link>
<link name="bob"><inertial><origin xyz="0 0 -1"/><mass value="1"/><inertia ixx=".1" ixy=".3" iyy=".1" izz=".1"/>
</inertial></link><link name="wheel"><inertial><mass value=".01"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/>
</inertial></link><link name="camera"/><link name="tip"/>
<joint name="leader" type="continuous"><parent link="base"/><child link="bob"/><origin rpy="0 -.5 0"/>
<axis xyz="0 1 0"/></joint><joint name="turns" type="continuous"><parent link="base"/><child link="wheel"/>
<mimic joint="leader" multiplier="2"/></joint>
<joint name="weld" type="fixed"><axis/><parent link="base"/><child link="camera"/></joint>
<joint name="free" type="continuous"><parent link="camera"/><child link="tip"/></joint></robot>"""


def test_a_robot_with_common_defects_is_loaded_and_its_joints_follow(tmp_path: Path) -> None:
    """Missing looks, an inertia that no body has, an axis without a direction, a link without mass, and `mimic`."""
    (tmp_path / "odd.urdf").write_text(ODD)
    odd = Obstacle(shape={"urdf": {"file": "odd.urdf", "radius": 2.0}}, position=[0, 0, 3])
    environment = MujocoEnvironment(MujocoEnvironment.Parameters(time_step=0.01))
    environment.folder = tmp_path
    nobody = AgentGroup("nobody", ["nobody"], SingleIntegrator(), Entity(), [[99.0, 99.0]])
    environment.initialise([nobody], {"odd": odd}, 1)
    order = list(environment.articulations()["odd"].joints)
    found = []
    for _ in range(100):
        environment.step()
        joints = environment.joint_positions("odd")
        assert joints is not None
        found.append(joints[0])
    leader, turns = np.array(found).T[[order.index("leader"), order.index("turns")]]
    assert np.isfinite(found).all()
    assert np.ptp(leader) > 0.5
    assert turns == pytest.approx(2.0 * leader, abs=0.01)


# -- repeats and states


def test_a_run_repeats_to_the_byte_and_its_log_verifies(tmp_path: Path) -> None:
    for name in ("one", "two"):
        sa.load(SCENARIOS / "pushing.yaml").run(output=tmp_path / f"{name}.mcap")
    one, two = (digest(sa.open_log(tmp_path / f"{name}.mcap")) for name in ("one", "two"))
    assert one.combined == two.combined
    assert sa.verify_log(str(tmp_path / "one.mcap")).is_equal


@pytest.mark.parametrize("step", [0, 1, 17, 40, 77])
def test_a_run_continues_from_its_state_to_the_same_bytes(step: int, tmp_path: Path) -> None:
    scenario = sa.load(SCENARIOS / "pushing.yaml")
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


def test_a_branch_of_a_physics_world_begins_from_a_captured_state(tmp_path: Path) -> None:
    sa.load(SCENARIOS / "pushing.yaml").run(output=tmp_path / "log.mcap")
    change = {"agents.robot[2].state": [0.0, 4.0]}
    (result,) = sa.branches(tmp_path / "log.mcap", 2.0, [change], tmp_path / "out", way="capture")
    assert result.way == "capture"


# -- unsupported features


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("environment.entities.light.shape={mesh: {file: flat.obj, radius: 1}}", "flat"),
        (
            "environment.entities.light.shape={urdf: {file: pendulum.urdf, radius: 1, scale: 2}}",
            "in the size of their files",
        ),
        (
            "environment.entities.light.shape={urdf: {file: floating.urdf, radius: 1}}",
            "the joint `hinge` is `floating`",
        ),
        (
            "agents.robot.entity.shape={urdf: {file: pendulum.urdf, radius: 1}}",
            "an agent of a model that drives its joints",
        ),
        ("environment.entities={ground: {shape: {circle: {radius: 1}}, position: [9, 9]}}", "names the ground"),
    ],
)
def test_unsupported_features_are_refused_at_their_place(change: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 3 2\n")
    robot_file(tmp_path)
    (tmp_path / "floating.urdf").write_text(URDF.format(kind="floating"))
    scenario = yaml.safe_load((SCENARIOS / "pushing.yaml").read_text())
    scenario["agents"]["robot"]["state"] = {"circle": {"radius": 3}}
    (tmp_path / "s.yaml").write_text(yaml.safe_dump({**scenario, "specifications": {}}))
    with pytest.raises(sa.ScenarioError, match=said):
        sa.load(tmp_path / "s.yaml", [change])


def test_the_conformance_kit_finds_no_deviation() -> None:
    check_environment(MujocoEnvironment)
