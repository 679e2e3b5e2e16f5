"""The planar world: features of Pymunk alone, above all joints."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pymunk
import pytest
import yaml
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Entity, Obstacle, WorldError
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.language.build import build
from symaware_cli.language.problem import ScenarioError
from symaware_cli.worlds.joint import Joint
from symaware_cli.worlds.planar import PymunkEnvironment

BALL = {"circle": {"radius": 0.1}}


def world(
    obstacles: Mapping[str, Any],
    joints: Mapping[str, Any] | None = None,
    state: tuple[float, float] = (99.0, 99.0),
    **parameters: Any,
) -> PymunkEnvironment:
    parameters = {"time_step": 0.02, "substeps": 20} | parameters
    group = AgentGroup("robot", ["robot"], SingleIntegrator(), Entity(shape=BALL), [state])
    environment = PymunkEnvironment(PymunkEnvironment.Parameters(joints=joints or {}, **parameters))
    environment.initialise([group], obstacles, 1)
    return environment


def ball(x: float, y: float = 0.0, mass: float | None = 1.0, **more: Sequence[float]) -> Obstacle:
    return Obstacle(shape=BALL, position=[x, y], mass=mass, **more)


def run(environment: PymunkEnvironment, time: float) -> NDArray[np.float64]:
    poses = []
    for _ in range(round(time / 0.02)):
        environment.step()
        poses.append([environment.pose(name).position for name in environment.obstacles])
    return np.array(poses)


def test_a_pendulum_swings_with_the_period_of_huygens() -> None:
    rope = {"rope": {"kind": "pin", "between": ["bob", None], "anchors": [[0, 0], [0, 1]]}}
    swing = 0.1
    bob = Obstacle(shape={"circle": {"radius": 1e-3}}, position=[np.sin(swing), 1 - np.cos(swing)], mass=1.0)
    with world({"bob": bob}, rope, gravity=(0.0, -9.81)) as environment:
        x = run(environment, 8.0)[:, 0, 0]
    crossings = (
        np.flatnonzero((x[:-1] > 0) & (x[1:] <= 0))
        + x[:-1][(x[:-1] > 0) & (x[1:] <= 0)] / -np.diff(x)[(x[:-1] > 0) & (x[1:] <= 0)]
    )
    period = np.diff(crossings).mean() * 0.02
    assert period == pytest.approx(2 * np.pi * np.sqrt(1 / 9.81) * (1 + swing**2 / 16), rel=0.005)


def test_a_spring_oscillates_with_the_frequency_of_its_stiffness() -> None:
    spring = {"spring": {"kind": "spring", "between": ["one", "other"], "length": 1.0, "stiffness": 50.0}}
    with world({"one": ball(0.0, mass=2.0), "other": ball(1.2, mass=2.0)}, spring) as environment:
        poses = run(environment, 4.0)
    apart = poses[:, 1, 0] - poses[:, 0, 0] - 1.0
    expected = 0.2 * np.cos(np.sqrt(50.0 / 1.0) * 0.02 * np.arange(1, 201))  # the reduced mass is 1 kg
    assert np.abs(apart - expected).max() < 0.02
    assert poses[:, :, 0].mean(axis=1) == pytest.approx(0.6, abs=1e-9)  # nothing moves the centre of both


def test_a_rope_holds_only_where_it_is_taut() -> None:
    rope = {"rope": {"kind": "slide", "between": ["one", None], "length": 1.0}}
    with world({"one": ball(0.5, velocity=[1.0, 0.0])}, rope) as environment:
        poses = run(environment, 2.0)
    assert poses[20, 0, 0] == pytest.approx(0.92, abs=0.01)
    assert poses[-1, 0, 0] == pytest.approx(1.0, abs=0.01)


def test_an_agent_pulls_a_trailer() -> None:
    tow = {"tow": {"kind": "pin", "between": ["robot", "trailer"]}}
    with world({"trailer": ball(-0.5)}, tow, state=(0.0, 0.0)) as environment:
        environment.groups[0].control_input = [[1.0, 0.0]]
        run(environment, 2.0)
        assert environment.state(environment.groups[0])[0] == pytest.approx([2.0, 0.0], abs=0.02)
        assert environment.pose("trailer").position == pytest.approx((1.5, 0.0), abs=0.02)


def test_a_motor_turns_a_hinged_body() -> None:
    joints = {
        "hinge": {"kind": "pivot", "between": ["wheel", None], "anchors": [[0, 0], [1, 1]]},
        "motor": {"kind": "motor", "between": ["wheel", None], "rate": 3.0},
    }
    with world({"wheel": ball(1.0, 1.0)}, joints) as environment:
        run(environment, 1.0)
        assert environment.pose("wheel").turn_rate == pytest.approx(3.0)
        assert environment.pose("wheel").position == pytest.approx((1.0, 1.0))


@pytest.mark.parametrize(
    ("joint", "said"),
    [
        ({"kind": "spring", "between": ["a", "b"], "length": 1.0}, "a spring needs a `stiffness`"),
        ({"kind": "slide", "between": ["a", "b"]}, "a slide needs a `length`"),
        ({"kind": "pin", "between": ["a", "b"], "rate": 1.0}, "a pin has no `rate`"),
        ({"kind": "pin", "between": ["a", "a"]}, "two different bodies"),
        ({"kind": "rod", "between": ["a", "b"]}, "kind"),
    ],
)
def test_a_joint_that_makes_no_sense_is_refused(joint: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Joint(**joint)


def test_a_joint_between_missing_or_immovable_bodies_is_refused() -> None:
    with pytest.raises(WorldError, match="refers to `ghost`") as caught:
        world({"a": ball(0.0)}, {"rod": {"kind": "pin", "between": ["a", "ghost"]}})
    assert caught.value.path[:4] == ("environment", "with", "joints", "rod")
    with pytest.raises(WorldError, match="immovable bodies"):
        world({"a": ball(0.0, mass=None)}, {"rod": {"kind": "pin", "between": ["a", None]}})


def test_the_kinematic_world_refuses_bodies_that_only_forces_move() -> None:
    group = AgentGroup("robot", ["robot"], SingleIntegrator(), Entity(), [[0.0, 0.0]])
    with pytest.raises(WorldError, match="give it a path") as caught:
        KinematicEnvironment().initialise([group], {"ball": ball(1.0, velocity=[1.0, 0.0])}, 1)
    assert caught.value.path == ("environment", "entities", "ball")


def test_a_free_box_rubs_to_a_stop_against_a_wall() -> None:
    """Coulomb friction: a box that is pressed on by 10 m/s^2 and rubs with 0.5 x 0.5 loses 2.5 m/s each second."""
    obstacles = {
        "box": Obstacle(shape={"box": {"length": 0.4, "width": 0.2}}, position=[0, 0.1], mass=1.0, velocity=[1.0, 0]),
        "floor": Obstacle(shape={"box": {"length": 20, "width": 2}}, position=[0, -1.0]),
    }
    with world(obstacles, gravity=(0.0, -10.0)) as environment:
        poses = run(environment, 1.0)
    assert poses[-1, 0, 0] == pytest.approx(1.0 / (2 * 2.5), abs=0.01)


def test_a_stack_holds() -> None:
    obstacles = {
        f"box{number}": Obstacle(
            shape={"box": {"length": 0.4, "width": 0.4}}, position=[0, 0.2 + 0.4 * number], mass=1.0, friction=0.8
        )
        for number in range(4)
    }
    obstacles["floor"] = Obstacle(shape={"box": {"length": 20, "width": 2}}, position=[0, -1.0])
    with world(obstacles, gravity=(0.0, -10.0)) as environment:
        run(environment, 3.0)
        heights = [environment.pose(f"box{number}").position[1] for number in range(4)]
    assert heights == pytest.approx([0.2, 0.6, 1.0, 1.4], abs=0.01)


def test_a_closed_world_releases_its_space() -> None:
    environment = world({"a": ball(0.0)})
    space = environment._space
    environment.close()
    environment.close()
    assert not space.bodies
    assert isinstance(space, pymunk.Space)


def test_without_pymunk_the_error_names_the_command_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = {
        "symaware": 1,
        "name": "plane",
        "run": {"duration": 0.2},
        "environment": {"use": "pymunk"},
        "agents": {"robot": {"model": {"use": "single-integrator"}, "state": [3, 3]}},
    }
    (tmp_path / "plane.yaml").write_text(yaml.safe_dump(scenario))
    for name in ("symaware_cli.worlds.planar", "symaware_cli.worlds.joint"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "pymunk", None)
    with pytest.raises(ScenarioError) as caught:
        build(tmp_path / "plane.yaml")
    (problem,) = caught.value.problems
    assert problem.code == "missing-extra"
    assert (problem.expected or "").startswith("the extra `pymunk`: pip install 'symaware-cli[pymunk]'")
