"""Contacts in physics worlds: their times, impulses and the speeds of separation."""

from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from symaware_cli.core import AgentGroup, Entity, Obstacle
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.worlds.contact_tracker import ContactTracker
from symaware_cli.worlds.physics import PhysicsEnvironment
from symaware_cli.worlds.planar import PymunkEnvironment
from symaware_cli.worlds.spatial import PyBulletEnvironment

BALL = {"circle": {"radius": 0.3}}
CRATE = {"box": {"length": 0.5, "width": 0.5, "height": 0.5}}
CAN = {"cylinder": {"radius": 0.25, "height": 0.5}}
SLAB = {"polygon": {"vertices": [[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]}}
PRISM = {"polygon": {"vertices": [[-0.2, -0.2], [0.2, -0.2], [0.0, 0.3]]}}


@pytest.fixture(params=[PymunkEnvironment, PyBulletEnvironment], ids=["pymunk", "pybullet"])
def kind(request: pytest.FixtureRequest) -> type[PhysicsEnvironment]:
    result: type[PhysicsEnvironment] = request.param
    return result


def world(
    kind: type[PhysicsEnvironment],
    obstacles: Mapping[str, Any],
    positions: Sequence[tuple[float, float]] = ((99.0, 99.0),),
    shape: Mapping[str, Any] | None = None,
    **parameters: Any,
) -> PhysicsEnvironment:
    if kind is PyBulletEnvironment:
        parameters = {"gravity": (0, 0, 0), "ground": None} | parameters
    environment = kind(kind.Parameters(**{"time_step": 0.05, "substeps": 10, **parameters}))
    ids = [f"robot.{row}" for row in range(len(positions))]
    environment.initialise([AgentGroup("robot", ids, SingleIntegrator(), Entity(shape=shape), positions)], obstacles, 1)
    return environment


def test_a_contact_tracker_adds_up_impulses_until_bodies_part_or_the_time_step_ends() -> None:
    tracker = ContactTracker(["a", "b", "c"], 0)
    tracker.begin((0, 1), (0.0, 0.0), 0.1)
    tracker.begin((0, 2), (0.0, 0.0), 0.1)
    for bodies, impulse in (((0, 1), 1.0), ((0, 2), 5.0), ((1, 2), 9.0), ((0, 1), 2.0)):
        tracker.add_impulse(bodies, impulse)
    tracker.end((0, 1))
    tracker.add_impulse((0, 1), 7.0)  # has parted
    tracker.add_impulse((0, 2), 0.5)
    tracker.end_time_step()
    tracker.add_impulse((0, 2), 7.0)  # in the next time step
    news = {(each.first, each.second): each.impulse for each in tracker.take_changes() if each.begins}
    assert news == {("a", "b"): 3.0, ("a", "c"): 5.5}


@pytest.mark.parametrize("shape", [BALL, CRATE, PRISM], ids=lambda shape: next(iter(shape)))
def test_bodies_in_one_place_at_the_start_are_reported_at_once(
    kind: type[PhysicsEnvironment], shape: dict[str, Any]
) -> None:
    obstacles = {name: Obstacle(shape=shape, position=[3.0, 0.0], mass=1.0) for name in ("one", "other")}
    with world(kind, obstacles, [(0.0, 0.0), (0.0, 0.0)], shape) as environment:
        told = environment.contacts()
        assert [(each.first, each.second) for each in told] == [("one", "other"), ("robot.0", "robot.1")]
        least = {"circle": 0.6, "box": 0.5}.get(next(iter(shape)))
        if least:
            assert [each.depth for each in told] == pytest.approx([least] * 2, abs=1e-6)
        assert all(each.depth > 0.3 for each in told)
        environment.step()
        assert environment.contacts() == []


@pytest.mark.parametrize("turned", [0.0, 0.5])
@pytest.mark.parametrize("elasticity", [0.0, 0.5])
@pytest.mark.parametrize("substeps", [1, 10])
def test_the_impulse_of_a_landing_body_is_the_change_of_its_momentum(
    kind: type[PhysicsEnvironment], elasticity: float, substeps: int, turned: float
) -> None:
    """Against a floor, with the impulse of the weight until the time step ends."""
    height = 0.25 if turned == 0.0 else 0.36
    obstacles = {
        "crate": Obstacle(
            shape=CRATE, position=[0, height], heading=turned, velocity=[0, -1], mass=2.0, elasticity=elasticity
        ),
        "floor": Obstacle(
            shape={"box": {"length": 9, "width": 1, "height": 9}}, position=[0, -0.5], friction=0.0, elasticity=1.0
        ),
    }
    gravity = (0, -10.0, 0)[: kind.dimensions]
    with world(kind, obstacles, gravity=gravity, time_step=0.002 * substeps, substeps=substeps) as environment:
        before = -1.0
        for _ in range(100):
            environment.step()
            after = environment.pose("crate").velocity[1]
            begun = [each for each in environment.contacts() if each.begins]
            if begun:
                break
            before = after
        weight = 2.0 * 10.0 * 0.002 * substeps
        assert begun[0].impulse == pytest.approx(2.0 * (after - before) + weight, rel=1e-6)
        if not turned:
            assert after == pytest.approx(-elasticity * before, abs=weight / 2.0 + 1e-3)


@pytest.mark.parametrize("shape", [BALL, CRATE, SLAB, CAN], ids=["ball", "crate", "prism", "can"])
@pytest.mark.parametrize("elasticity", [1.0, 0.5, 0.0])
@pytest.mark.parametrize("speed", [0.5, 7.0])
def test_two_bodies_part_according_to_their_elasticity(
    kind: type[PhysicsEnvironment], shape: dict[str, Any], elasticity: float, speed: float
) -> None:
    """Newton's law of restitution, with default settings, for 1 and 2 kg; momentum is kept in any case."""
    more = {"shape": shape, "friction": 0.0}
    obstacles = {
        "one": Obstacle(position=[0.003, 0], velocity=[speed, 0], mass=1.0, elasticity=elasticity, **more),
        "other": Obstacle(position=[0.9, 0], mass=2.0, elasticity=1.0, **more),
    }
    with world(kind, obstacles) as environment:
        while environment.snapshot().time < 1e9 / speed:
            environment.step()
        one, other = (environment.pose(name).velocity[0] for name in obstacles)
    # Of other shapes than boxes and balls PyBullet finds the points of contact one by one.
    tolerance = 0.2 if kind is PyBulletEnvironment and shape in (SLAB, CAN) else 0.01
    assert other - one == pytest.approx(elasticity * speed, abs=tolerance * speed)
    assert one + 2.0 * other == pytest.approx(speed, abs=1e-9)
