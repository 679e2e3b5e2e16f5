"""A world that follows another one equals it in all queries."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from simulating import present

from symaware_cli import Environment
from symaware_cli.language.build import build

WORLDS = [
    ("three-worlds.yaml", "kinematic"),
    ("three-worlds.yaml", "pymunk"),
    ("three-worlds.yaml", "pybullet"),
    ("billiards.yaml", "pymunk"),
    ("racecars.yaml", "pybullet"),
    ("drones.yaml", "pybullet"),
]


@pytest.fixture(params=WORLDS, ids=lambda param: "-".join(param))
def both(request: pytest.FixtureRequest, scenarios: Path) -> Iterator[tuple[Environment, Environment]]:
    """A world that has moved for a while, and one that followed it."""
    name, use = request.param
    overrides = [f"environment.use={use}"] if name == "three-worlds.yaml" else []
    one, other = (build(scenarios / name, overrides).simulation for _ in range(2))
    with one.environment as world, other.environment as follower:
        assert world.is_shared
        for group in one.groups:
            group.control_input = group.control_input + 0.3
        for _ in range(20):
            world.step()
        shared = {name: np.array(values) for name, values in world.share().items()}
        follower.follow(world.snapshot().time, shared, world.contacts())
        yield world, follower


def test_states_inputs_velocities_and_contacts_are_the_same(both: tuple[Environment, Environment]) -> None:
    world, follower = both
    assert follower.snapshot().time == world.snapshot().time
    for group, same in zip(world.groups, follower.groups, strict=True):
        np.testing.assert_array_equal(follower.state(same), world.state(group))
        np.testing.assert_array_equal(follower.applied_input(same), world.applied_input(group))
    np.testing.assert_array_equal(follower.snapshot().velocities, world.snapshot().velocities)
    assert follower.contacts() == tuple(world.contacts())


def test_entities_have_the_poses_of_the_other_process(both: tuple[Environment, Environment]) -> None:
    world, follower = both
    for name in world.obstacles:
        assert follower.pose(name) == world.pose(name)
    names = [*world.roster.ids, *world.obstacles]
    np.testing.assert_allclose(follower.body_positions(names), world.body_positions(names), atol=1e-12)


def test_rays_meet_the_same_bodies(both: tuple[Environment, Environment]) -> None:
    positions = both[0].snapshot().positions
    angles = np.linspace(0.1, 6.2, 30)
    directions = np.tile(np.stack([np.cos(angles), np.sin(angles)], axis=1), (len(positions), 1, 1))
    senders = np.arange(len(positions))
    there, here = (each.ray_cast(senders, positions, directions, 6.0) for each in both)
    np.testing.assert_allclose(here, there, atol=1e-9)
    assert np.isfinite(there).any()


def test_joints_have_the_positions_of_the_other_process(both: tuple[Environment, Environment]) -> None:
    world, follower = both
    for name in world.articulations():
        there = world.joint_positions(name)
        if there is not None:
            np.testing.assert_allclose(present(follower.joint_positions(name)), there, atol=1e-12)


def test_arrays_of_another_world_are_refused(both: tuple[Environment, Environment]) -> None:
    world, follower = both
    shared = {name: np.array(values) for name, values in world.share().items()}
    first = next(iter(shared))
    with pytest.raises(ValueError, match=first):
        follower.follow(0, shared | {first: shared[first][:, :1]}, ())
    del shared[first]
    with pytest.raises(ValueError, match=first):
        follower.follow(0, shared, ())
