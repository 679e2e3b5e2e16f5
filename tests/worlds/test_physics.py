"""Physics worlds: both engines against closed forms and the kinematic world."""

import gc
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT
from engine_clients import pybullet_clients
from leftovers import grows_forever
from numpy.typing import ArrayLike, NDArray
from simulating import Team, made, moved, simulate

from symaware_cli import Model
from symaware_cli.core import AgentGroup, Entity, Obstacle, WorldError
from symaware_cli.engine.components.perception_range import RangePerception
from symaware_cli.engine.environments.column_environment import ColumnEnvironment
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.models.bicycle import Bicycle
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.linear import Linear
from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log.digest import Digest, digest
from symaware_cli.log.reader import open_log
from symaware_cli.worlds.physics import PhysicsEnvironment
from symaware_cli.worlds.planar import PymunkEnvironment
from symaware_cli.worlds.spatial import PyBulletEnvironment

SCENARIOS = CHECKOUT / "scenarios"
KINDS: dict[str, Any] = {"pymunk": PymunkEnvironment, "pybullet": PyBulletEnvironment}
BALL = {"circle": {"radius": 0.1}}
CRATE = {"box": {"length": 0.4, "width": 0.4, "height": 0.4}}


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> type[PhysicsEnvironment]:
    result: type[PhysicsEnvironment] = KINDS[request.param]
    return result


def ball(x: float, speed: float | None = None, *, y: float = 0.0, mass: float = 1.0, **more: float) -> Obstacle:
    velocity = None if speed is None else [speed, 0.0]
    return Obstacle(shape=BALL, position=[x, y], mass=mass, velocity=velocity, **more)


def group(model: Model, state: ArrayLike, name: str = "robot", **entity: Any) -> AgentGroup:
    rows = np.atleast_2d(np.array(state, float))
    ids = [f"{name}.{row}" for row in range(len(rows))]
    return AgentGroup(name, ids, model, Entity(**{"shape": BALL, **entity}), rows)


def world(
    kind: type[ColumnEnvironment],
    groups: Sequence[AgentGroup] = (),
    obstacles: Mapping[str, Any] | None = None,
    seed: int = 1,
    **parameters: Any,
) -> ColumnEnvironment:
    """A world of weightless bodies by default, with a distant agent if there is no other."""
    if kind is PyBulletEnvironment:
        parameters = {"gravity": (0, 0, 0), "ground": None, "recovery": 0.0} | parameters
    environment = made(kind, **{"time_step": 0.02, "substeps": 4, **parameters})
    environment.initialise(groups or [group(SingleIntegrator(), [99.0, 99.0])], obstacles or {}, seed)
    return environment


def speed(environment: ColumnEnvironment, name: str) -> float:
    return float(environment.pose(name).velocity[0])


# -- the same in three worlds


@pytest.mark.parametrize("use", KINDS)
def test_without_contacts_worlds_hardly_differ(use: str, tmp_path: Path) -> None:
    def motion(world: str) -> dict[str, NDArray[np.float64]]:
        log = tmp_path / f"{world}.mcap"
        summary = execute(build(SCENARIOS / "three-worlds.yaml", [f"environment.use={world}"]), log)
        assert (summary.status, summary.contacts, len(summary.goals_reached)) == ("finished", 0, 6)
        return {name: open_log(log).series(name, "world").values for name in ("disc", "puck", "cart")}

    truth, found = motion("kinematic"), motion(use)
    # Pymunk moves bodies before it changes their velocity: each is late by a physics step of 5 ms at up to 1.2 m/s.
    # Both change a velocity at the end of a physics step, not evenly within it: half a step for the puck.
    # The cart turns to its next waypoint a time step sooner or later for that.
    tolerance = {"disc": 0.0061, "puck": 0.0031, "cart": 0.07} if use == "pymunk" else {"disc": 1e-9, "puck": 0.0031}
    for name, values in truth.items():
        assert np.abs(found[name] - values).max() < tolerance.get(name, 1e-9), name


@pytest.mark.parametrize(
    ("model", "state", "control_input"),
    [
        (SingleIntegrator(), [1.0, 2.0], [0.7, -0.4]),
        (DoubleIntegrator(), [1.0, 2.0, 0.3, 0.1], [0.5, -0.2]),
        (Unicycle(), [1.0, 2.0, 3.0], [0.9, 1.4]),
        (Bicycle(), [1.0, 2.0, -3.0], [0.9, 0.5]),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_body_goes_where_its_model_goes(
    kind: type[PhysicsEnvironment], model: NoisyModel, state: list[float], control_input: list[float]
) -> None:
    truth, found = (
        world(each, [group(model, state)], time_step=0.05, substeps=substeps)
        for each, substeps in ((KinematicEnvironment, 1), (kind, 10))
    )
    for environment in (truth, found):
        environment.groups[0].control_input = [control_input]
        moved(environment, 2.0)
    mine, theirs = found.state(found.groups[0]), truth.state(truth.groups[0])
    assert np.abs(mine - theirs).max() < 0.0125  # a physics step of 5 ms at 1 m/s, and turned by 1.4 rad/s for as long
    if kind is PyBulletEnvironment and not model.velocities:
        assert np.allclose(mine, theirs, atol=1e-9)
    found.close()


def test_agents_start_exactly_in_the_states_of_the_file(kind: type[PhysicsEnvironment]) -> None:
    robots = group(Unicycle(), [[1.1, -2.3, 0.7], [-4.9, 0.3, -2.1]], shape=CRATE)
    obstacles = {
        "free": Obstacle(shape=CRATE, position=[3.3, 7.7], heading=0.9, mass=1.0, velocity=[0.1, 0.2], turn_rate=0.3),
        "rock": Obstacle(shape=CRATE, position=[-3.3, 7.7], heading=-0.9),
    }
    with world(kind, [robots], obstacles) as environment:
        assert environment.state(robots) == pytest.approx(robots.initial_state, abs=1e-12)
        for name, obstacle in obstacles.items():
            pose = environment.pose(name)
            assert pose.position[:2] == pytest.approx(obstacle.position, abs=1e-12)
            assert pose.heading == pytest.approx(obstacle.heading, abs=1e-12)
        assert environment.pose("free").velocity[:2] == pytest.approx((0.1, 0.2), abs=1e-12)
        assert environment.pose("free").turn_rate == pytest.approx(0.3, abs=1e-12)


def test_a_heading_counts_turns(kind: type[PhysicsEnvironment]) -> None:
    spinner = group(Unicycle(), [0.0, 0.0, 7.0])
    with world(kind, [spinner]) as environment:
        assert environment.state(spinner)[0, 2] == pytest.approx(7.0)
        spinner.control_input = [[0.0, 2.0]]
        moved(environment, 5.0)
        assert environment.state(spinner)[0, 2] == pytest.approx(17.0, abs=0.02)


def test_the_velocities_of_a_snapshot_are_those_of_the_bodies(kind: type[PhysicsEnvironment]) -> None:
    robot = group(SingleIntegrator(), [0.0, 0.0])
    obstacles = {"wall": Obstacle(shape={"box": {"length": 1, "width": 5}}, position=[1.0, 0.0])}
    with world(kind, [robot], obstacles) as environment:
        robot.control_input = [[1.0, 0.0]]
        moved(environment, 0.1)
        assert np.allclose(environment.snapshot().velocities[0, :2], [1.0, 0.0])
        moved(environment, 0.9)
        assert np.allclose(environment.snapshot().velocities[0, :2], [0.0, 0.0], atol=0.01)
        assert environment.state(robot)[0, 0] == pytest.approx(0.4, abs=0.01)
        assert environment.applied_input(robot).tolist() == [[1.0, 0.0]]


def test_process_noise_moves_bodies_through_their_velocity(kind: type[PhysicsEnvironment]) -> None:
    robots = group(SingleIntegrator(SingleIntegrator.Parameters(process_noise=0.1)), np.zeros((200, 2)), shape=None)
    with world(kind, [robots], time_step=0.1) as environment:
        moved(environment, 1.0)
        spread = environment.state(robots).std()
    assert spread == pytest.approx(0.1, rel=0.15)


# -- closed forms


@pytest.mark.parametrize(("elasticity", "masses"), [(1.0, (1, 1)), (1.0, (1, 3)), (0.5, (2, 1)), (0.0, (1, 1))])
def test_a_collision_conserves_momentum_and_the_elastic_share_of_the_energy(
    kind: type[PhysicsEnvironment], elasticity: float, masses: tuple[int, int]
) -> None:
    """Newton's law of restitution; R. C. Hibbeler, Engineering Mechanics: Dynamics, section 15.4."""
    one, other = masses
    obstacles = {
        "one": ball(0.0, 2.0, mass=one, elasticity=elasticity, friction=0.0),
        "other": ball(0.5, mass=other, elasticity=1.0, friction=0.0),
    }
    with world(kind, obstacles=obstacles) as environment:
        contacts = moved(environment, 0.5)
        after = [speed(environment, name) for name in ("one", "other")]
    common = one * 2.0 / (one + other)
    away = elasticity * 2.0
    expected = [common - other * away / (one + other), common + one * away / (one + other)]
    assert after == pytest.approx(expected, abs=0.01)
    assert one * after[0] + other * after[1] == pytest.approx(2.0 * one, abs=1e-9)
    began = contacts[0]
    assert (began.first, began.second, began.begins) == ("one", "other", True)
    assert began.impulse == pytest.approx(other * expected[1], rel=0.01)
    # Both engines find an overlap of up to one physics step, 2 m/s for 5 ms.
    assert began.point[0] == pytest.approx(0.4, abs=0.011)


@pytest.mark.parametrize("shape", [{"circle": {"radius": 0.2}}, CRATE], ids=["balls", "boxes"])
@pytest.mark.parametrize("elasticity", [0.5, 0.9, 1.0])
def test_a_bounce_loses_speed_by_its_elasticity_at_any_speed(
    kind: type[PhysicsEnvironment], elasticity: float, shape: dict[str, Any]
) -> None:
    for pace in (0.005, 0.01, 0.03, 0.1, 0.5, 2.0, 8.0, 20.0):
        # Where in a physics step they meet, and so how deep the engine finds them in each other, must not matter.
        for share in (0.0, 1e-6, 1e-3, 0.1, 0.5, 0.999):
            gap = 0.2 + (4 + share) * pace * 0.005
            obstacles = {
                name: Obstacle(
                    shape=shape,
                    position=[side * gap, 0.0],
                    velocity=[-side * pace, 0.0],
                    mass=1.0,
                    elasticity=part,
                    friction=0.0,
                )
                for name, side, part in (("one", -1, 1.0), ("other", 1, elasticity))
            }
            recovery: dict[str, Any] = {"recovery": 0.02} if kind is PyBulletEnvironment else {}
            with world(kind, obstacles=obstacles, **recovery) as environment:
                moved(environment, 0.2)
                away = speed(environment, "other") - speed(environment, "one")
            assert away == pytest.approx(elasticity * 2 * pace, rel=0.01), (pace, share)


def test_a_bounce_within_a_time_step_is_a_contact_with_its_impulse(kind: type[PhysicsEnvironment]) -> None:
    obstacles = {
        "ball": ball(0.0, 10.0, mass=2.0, elasticity=1.0),
        "rock": Obstacle(shape=BALL, position=[0.7, 0.0], elasticity=1.0),
        "stone": Obstacle(shape=BALL, position=[-0.7, 0.0], elasticity=1.0),
    }
    with world(kind, obstacles=obstacles, time_step=0.3, substeps=300) as environment:
        environment.step()
        contacts = environment.contacts()
        # To the rock, to the stone and to the rock again: 0.5 + 1.0 + 1.0 m, all within one step.
        assert speed(environment, "ball") == pytest.approx(-10.0, rel=0.01)
    met = [(each.first, each.second, each.begins) for each in contacts]
    twice, once = [("ball", "rock", True), ("ball", "rock", False)] * 2, [("ball", "stone", True)]
    assert met == [*twice, *once, ("ball", "stone", False)]
    assert [each.impulse for each in contacts if each.begins] == pytest.approx([40.0] * 3, rel=0.01)


def test_a_crowd_keeps_its_momentum_and_its_energy(kind: type[PhysicsEnvironment]) -> None:
    generator = np.random.default_rng(5)
    obstacles = {
        f"ball{number}": Obstacle(
            shape=BALL,
            mass=1.0 + number % 3,
            position=[0.25 * (number % 4), 0.25 * (number // 4)],
            velocity=generator.uniform(-1, 1, 2).tolist(),
            elasticity=1.0,
            friction=0.0,
        )
        for number in range(16)
    }
    masses = np.array([each.mass for each in obstacles.values()])

    def motion(environment: ColumnEnvironment) -> tuple[NDArray[np.float64], float]:
        velocities = np.array([environment.pose(name).velocity[:2] for name in obstacles])
        return masses @ velocities, 0.5 * masses @ (velocities * velocities).sum(axis=1)

    with world(kind, obstacles=obstacles, substeps=20) as environment:
        momentum, energy = motion(environment)
        contacts = moved(environment, 2.0)
        after = motion(environment)
    assert sum(each.begins for each in contacts) > 15
    assert after[0] == pytest.approx(momentum, abs=1e-9)
    assert after[1] == pytest.approx(energy, rel=0.01)


def test_a_glancing_collision_without_friction_keeps_the_tangential_velocity(kind: type[PhysicsEnvironment]) -> None:
    # The centres are 45 degrees apart when they meet: the one goes on along the tangent, the other along the normal.
    offset = 0.2 * np.sqrt(0.5)
    obstacles = {
        "one": ball(0.0, 1.0, elasticity=1.0, friction=0.0),
        "other": ball(0.5 + offset, y=offset, elasticity=1.0, friction=0.0),
    }
    with world(kind, obstacles=obstacles, time_step=0.002) as environment:
        moved(environment, 1.0)
        velocities = np.array([environment.pose(name).velocity[:2] for name in ("one", "other")])
    assert velocities == pytest.approx(np.array([[0.5, -0.5], [0.5, 0.5]]), abs=0.01)


def test_a_falling_body_follows_galileis_law(kind: type[PhysicsEnvironment]) -> None:
    obstacles = {"stone": Obstacle(shape=BALL, position=[0, 0, 0], mass=2.0, velocity=[1.0, 0, 0])}
    gravity = (0, -10.0) if kind is PymunkEnvironment else (0, -10.0, 0)
    with world(kind, obstacles=obstacles, gravity=gravity) as environment:
        moved(environment, 1.0)
        x, y, *_ = environment.pose("stone").position
    assert x == pytest.approx(1.0, abs=1e-9)
    # The engines change the velocity at one end of a physics step: g t step / 2.
    assert y == pytest.approx(-5.0, abs=10 * 0.005 / 2 + 1e-9)


def test_damping_takes_its_part_of_the_velocity_each_second(kind: type[PhysicsEnvironment]) -> None:
    with world(kind, obstacles={"puck": ball(0.0, 3.0)}, damping=0.4) as environment:
        moved(environment, 2.0)
        assert speed(environment, "puck") == pytest.approx(3.0 * 0.6**2, rel=1e-6)


def test_neither_gravity_nor_damping_diverts_a_body_that_follows_a_model(kind: type[PhysicsEnvironment]) -> None:
    robot = group(SingleIntegrator(), [0.0, 0.0])
    gravity = (3.0, -10.0) if kind is PymunkEnvironment else (3.0, 0.0, -10.0)
    with world(kind, [robot], gravity=gravity, damping=0.5) as environment:
        robot.control_input = [[1.0, 0.5]]
        moved(environment, 2.0)
        assert environment.state(robot)[0] == pytest.approx([2.0, 1.0], abs=0.006)


def test_a_force_that_is_limited_takes_its_time(kind: type[PhysicsEnvironment]) -> None:
    robot = group(SingleIntegrator(), [0.0, 0.0], mass=4.0, max_force=2.0)
    with world(kind, [robot]) as environment:
        robot.control_input = [[1.0, 0.0]]
        moved(environment, 1.0)
        # 2 N push 4 kg: 0.5 m/s after a second, and 0.25 m.
        assert environment.snapshot().velocities[0, 0] == pytest.approx(0.5, abs=1e-6)
        assert environment.state(robot)[0, 0] == pytest.approx(0.25, abs=0.002)


def test_a_torque_that_is_limited_takes_its_time(kind: type[PhysicsEnvironment]) -> None:
    robot = group(Unicycle(), [0.0, 0.0, 0.0], shape=CRATE, mass=3.0, max_torque=0.04)
    with world(kind, [robot]) as environment:
        robot.control_input = [[0.0, 2.0]]
        moved(environment, 1.0)
        # The moment of a square plate about its centre is m a^2 / 6 = 0.08 kg m^2.
        assert environment.state(robot)[0, 2] == pytest.approx(0.25, abs=0.002)


# -- who meets whom


def test_the_greater_force_wins(kind: type[PhysicsEnvironment]) -> None:
    strong = group(SingleIntegrator(), [-0.3, 0.0], "strong", max_force=20.0, shape=CRATE)
    weak = group(SingleIntegrator(), [0.3, 0.0], "weak", max_force=5.0, shape=CRATE)
    with world(kind, [strong, weak]) as environment:
        strong.control_input, weak.control_input = [[1.0, 0.0]], [[-1.0, 0.0]]
        moved(environment, 1.0)
        assert environment.state(strong)[0, 0] > 0.3
        assert environment.state(weak)[0, 0] - environment.state(strong)[0, 0] == pytest.approx(0.4, abs=0.02)


def test_an_agent_with_a_velocity_in_its_state_bounces_and_keeps_the_rest(kind: type[PhysicsEnvironment]) -> None:
    puck = group(DoubleIntegrator(), [0.0, 0.0, 1.0, 0.5], elasticity=1.0, friction=0.0)
    obstacles = {"wall": Obstacle(shape={"box": {"length": 1, "width": 9}}, position=[1.0, 0.0], elasticity=1.0)}
    with world(kind, [puck], obstacles) as environment:
        contacts = moved(environment, 1.0)
        assert environment.state(puck)[0, 2:] == pytest.approx([-1.0, 0.5], abs=0.005)
    assert [(each.first, each.second, each.begins) for each in contacts] == [
        ("robot.0", "wall", True),
        ("robot.0", "wall", False),
    ]
    assert contacts[0].impulse == pytest.approx(2.0, rel=0.005)


def test_a_body_on_a_path_pushes_free_bodies_and_is_not_diverted(kind: type[PhysicsEnvironment]) -> None:
    path = {"times": [0, 1, 2], "positions": [[-1, 0], [0, 0], [1, 0]]}
    obstacles = {"bus": Obstacle(shape=CRATE, path=path), "ball": ball(0.0, mass=5.0)}
    with world(kind, obstacles=obstacles) as environment:
        moved(environment, 1.5)
        assert environment.pose("bus").position[:2] == pytest.approx((0.5, 0.0))
        assert environment.pose("ball").position[0] > 0.79
        assert environment.moves("bus")
        assert environment.moves("ball")


def test_a_body_without_mass_stays_in_place(kind: type[PhysicsEnvironment]) -> None:
    rock = Obstacle(shape=CRATE, position=[0.5, 0.0])
    with world(kind, obstacles={"rock": rock, "ball": ball(0.0, 3.0)}) as environment:
        moved(environment, 1.0)
        assert environment.pose("rock").position == (0.5, 0.0)
        assert not environment.moves("rock")


@pytest.mark.parametrize(
    "shape",
    [
        {"circle": {"radius": 0.2}},
        {"box": {"length": 0.4, "width": 0.2}},
        {"cylinder": {"radius": 0.2, "height": 0.4}},
        {"polygon": {"vertices": [[-0.2, -0.2], [0.2, -0.2], [0.0, 0.3]]}},
    ],
    ids=lambda shape: next(iter(shape)),
)
def test_every_shape_is_agent_free_entity_or_scenery_alike(
    kind: type[PhysicsEnvironment], shape: dict[str, Any]
) -> None:
    robot = group(SingleIntegrator(), [-1.0, 0.0], shape=shape)
    obstacles = {
        "free": Obstacle(shape=shape, position=[0.0, 0.0], mass=0.5),
        "rock": Obstacle(shape=shape, position=[1.0, 0.0]),
    }
    with world(kind, [robot], obstacles) as environment:
        robot.control_input = [[1.0, 0.0]]
        contacts = moved(environment, 2.0)
        assert {(each.first, each.second) for each in contacts} >= {("free", "robot.0"), ("free", "rock")}
        assert environment.state(robot)[0, 0] < 0.75  # nobody goes through


def test_a_wall_keeps_all_bodies_in(kind: type[PhysicsEnvironment]) -> None:
    yard = {"wall": {"points": [[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]], "thickness": 0.1}}
    robots = group(SingleIntegrator(), [[0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [0.5, 0.5]])
    with world(kind, [robots], {"yard": Obstacle(shape=yard)}) as environment:
        robots.control_input = [[1.0, 0.3], [-1.0, 0.5], [0.3, -1.0], [0.5, 1.0]]
        moved(environment, 4.0)
        assert np.abs(environment.state(robots)).max() < 0.9


def test_an_agent_that_slides_along_parts_of_a_wall_does_not_get_caught(kind: type[PhysicsEnvironment]) -> None:
    wall = {"wall": {"points": [[-2, 0], [-0.5, 0], [0.5, 0], [2, 0]], "thickness": 0.1}}
    robot = group(SingleIntegrator(), [-1.0, 0.2], max_force=5.0)
    with world(kind, [robot], {"wall": Obstacle(shape=wall, friction=0.0)}) as environment:
        robot.control_input = [[1.0, -0.2]]
        contacts = moved(environment, 2.0)
        x, y = environment.state(robot)[0]
        assert x > 0.8
        assert y == pytest.approx(0.15, abs=1e-3)
    # Pymunk has it hop by a tenth of a millimetre where one part ends; PyBullet counts a gap of 5 mm as none.
    assert sum(each.begins for each in contacts) - sum(not each.begins for each in contacts) == 1
    assert len(contacts) == 1 or kind is PymunkEnvironment


def test_bodies_that_overlap_at_the_start_are_reported_and_separated(kind: type[PhysicsEnvironment]) -> None:
    robots = group(SingleIntegrator(), [[0.0, 0.0], [0.15, 0.0]], max_force=0.01)
    obstacles = {"rock": Obstacle(shape=BALL, position=[0.0, 0.18])}
    parameters: dict[str, Any] = {} if kind is PymunkEnvironment else {"recovery": 0.1}
    with world(kind, [robots], obstacles, **parameters) as environment:
        contacts = environment.contacts()
        assert [(each.first, each.second, each.begins) for each in contacts] == [
            ("robot.0", "robot.1", True),
            ("robot.0", "rock", True),
        ]
        assert [each.depth for each in contacts] == pytest.approx([0.05, 0.02], abs=1e-6)
        later = moved(environment, 5.0)
        apart = environment.state(robots)
        assert np.linalg.norm(apart[0] - apart[1]) > 0.19
    begun = [each for each in later if each.begins]
    assert len(begun) == len({(each.first, each.second) for each in begun})


def test_the_scenery_follows_moving_bodies(kind: type[PhysicsEnvironment]) -> None:
    obstacles = {"ball": ball(0.0, 1.0), "rock": Obstacle(shape=BALL, position=[5.0, 0.0])}
    with world(kind, obstacles=obstacles) as environment:
        before = environment.scenery
        moved(environment, 1.0)
        near = environment.scenery.nearest(np.array([[1.0, 0.5]]), 1.0)
        assert near.distance == pytest.approx([0.4], abs=0.01)
        assert near.velocity[0] == pytest.approx([1.0, 0.0])
        # What was handed out does not change.
        assert before.nearest(np.array([[0.0, 0.5]]), 1.0).distance == pytest.approx([0.4])


@pytest.mark.parametrize("delay", [0.0, 0.5])
def test_a_pushed_body_hides_bodies_behind_its_position_at_that_time(
    kind: type[PhysicsEnvironment], delay: float, tmp_path: Path
) -> None:
    sense = {"see": lambda: made(RangePerception, range=9.0, occlusion=True, delay=delay)}
    team = Team(sense, 2, [[-2.0, 0.0], [2.0, 0.0]], entity=Entity(shape=BALL))
    # A crate of 0.4 m slides at 1 m/s through the line of sight, from 0.8 to 1.2 s.
    crate = Obstacle(shape=CRATE, position=[0.0, -1.0], mass=1.0, velocity=[0.0, 1.0])
    space = {} if kind is PymunkEnvironment else {"gravity": (0, 0, 0), "ground": None}
    with made(kind, time_step=0.05, substeps=5, **space) as environment:
        simulate({"robot": team}, 60, tmp_path / "log", environment=environment, obstacles={"crate": crate})
    seen = {
        round(message.time / 1e9, 2): len(message.decode().entities)
        for message in open_log(tmp_path / "log").messages("/agents/robot/awareness")
    }
    hidden = [time for time, count in seen.items() if count == 0 and time >= delay]
    assert min(hidden) == pytest.approx(0.8 + delay, abs=0.06)
    assert max(hidden) == pytest.approx(1.2 + delay, abs=0.06)


# -- logs, repetition and leaks


def crowded(kind: type[PhysicsEnvironment], path: Path, seed: int = 3) -> Digest:
    obstacles = {f"ball{number}": ball(0.3 * number, y=0.21 * (number % 3)) for number in range(12)}
    obstacles["yard"] = Obstacle(shape={"wall": {"points": [[-2, -2], [5, -2], [5, 2], [-2, 2], [-2, -2]]}})
    team = Team(count=3, state=[[-1.0, 0.0, 1.0, 0.0], [-1.0, 0.3, 1.5, 0.0], [-1.0, 0.6, 2.0, 0.1]])
    team.model, team.entity = DoubleIntegrator(), Entity(shape=BALL, elasticity=0.9)
    environment = made(kind, time_step=0.02, substeps=4)
    with environment:
        simulate({"puck": team}, 150, path, environment=environment, obstacles=obstacles, seed=seed)
    return digest(open_log(path))


def test_a_run_repeats_byte_for_byte_after_other_worlds_in_the_process(
    kind: type[PhysicsEnvironment], tmp_path: Path
) -> None:
    first = crowded(kind, tmp_path / "first.mcap")
    others = [world(each, obstacles={"ball": ball(0.0, 1.0)}) for each in KINDS.values() for _ in range(3)]
    for other in others[::2]:
        moved(other, 0.1)
    between = crowded(kind, tmp_path / "between.mcap")
    for other in others:
        other.close()
    after = crowded(kind, tmp_path / "after.mcap")
    assert first.combined == between.combined == after.combined


def test_contacts_and_free_bodies_are_in_the_log(kind: type[PhysicsEnvironment], tmp_path: Path) -> None:
    crowded(kind, tmp_path / "log.mcap")
    log = open_log(tmp_path / "log.mcap")
    assert log.manifest["entities"]["ball0"]["moves"] is True
    assert log.manifest["entities"]["yard"]["moves"] is False
    assert len(log.series("ball0", "world").times) > 100
    decoded = [message.decode() for message in log.messages("/contacts")]
    assert any(contact.impulse > 0.1 for contact in decoded)


def test_worlds_live_side_by_side(kind: type[PhysicsEnvironment]) -> None:
    pair = [world(kind, obstacles={"ball": ball(0.0, float(number))}) for number in (1, 2)]
    for _ in range(50):
        for environment in pair:
            environment.step()
    assert [environment.pose("ball").position[0] for environment in pair] == pytest.approx([1.0, 2.0])
    for environment in pair:
        environment.close()


def test_worlds_leave_neither_memory_nor_clients_behind(kind: type[PhysicsEnvironment]) -> None:
    def one() -> None:
        with world(kind, [group(SingleIntegrator(), np.zeros((5, 2)))], {"ball": ball(3.0)}) as environment:
            moved(environment, 0.04)

    before = pybullet_clients()
    assert not grows_forever(one, repeats=40, each=10_000)
    assert pybullet_clients() <= before


def test_an_unclosed_world_is_closed_when_it_is_garbage_collected() -> None:
    gc.collect()
    before = pybullet_clients()
    environment = world(PyBulletEnvironment)
    assert len(pybullet_clients() - before) == 1
    environment.close()
    environment.close()
    assert pybullet_clients() == before
    world(PyBulletEnvironment)
    gc.collect()
    assert pybullet_clients() == before


# -- what cannot be done is said before the run


LINEAR = {"state": {"x": "m", "y": "m"}, "control_input": {"a": "m", "b": "m"}, "A": np.eye(2).tolist()}


def test_a_map_over_the_time_step_is_followed_and_over_another_is_refused(kind: type[PhysicsEnvironment]) -> None:
    robot = group(made(Linear, time_step=0.02, B=np.eye(2).tolist(), **LINEAR), [0.0, 0.0])
    with world(kind, [robot]) as environment:
        robot.control_input = [[0.01, 0.02]]
        moved(environment, 1.0)
        assert environment.state(robot)[0] == pytest.approx([0.5, 1.0], abs=0.01)
    with pytest.raises(WorldError, match="both need the same `time_step`"):
        world(kind, [robot], time_step=0.05)


def test_a_model_with_more_than_a_body_has_is_refused(kind: type[PhysicsEnvironment]) -> None:
    more = {"state": {"x": "m", "y": "m", "fuel": "kg"}, "control_input": {"a": "m"}, "A": np.eye(3).tolist()}
    robot = group(made(Linear, time_step=0.02, B=[[1.0], [0.0], [0.0]], **more), [0.0, 0.0, 1.0])
    with pytest.raises(WorldError, match="has `fuel` too") as caught:
        world(kind, [robot])
    assert caught.value.path == ("agents", "robot", "model")


def test_a_planar_world_refuses_models_that_move_in_space() -> None:
    with pytest.raises(WorldError, match="cannot move in a plane"):
        world(PymunkEnvironment, [group(made(SingleIntegrator, dimensions=3), [0, 0, 0])])


def test_noise_that_tears_a_position_from_its_velocity_is_refused(kind: type[PhysicsEnvironment]) -> None:
    noisy = DoubleIntegrator(DoubleIntegrator.Parameters(process_noise=0.1))
    with pytest.raises(WorldError, match="process_noise"):
        world(kind, [group(noisy, [0.0, 0.0, 0.0, 0.0])])
    sound = DoubleIntegrator(DoubleIntegrator.Parameters(process_noise=[0, 0, 0.1, 0.1]))
    with world(kind, [group(sound, [0.0, 0.0, 0.0, 0.0])]) as environment:
        moved(environment, 0.1)
        assert environment.state(environment.groups[0])[0, 2:].any()
