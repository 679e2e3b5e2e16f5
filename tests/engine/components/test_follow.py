"""Following: by belief, without a word."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from simulating import Team, execute, simulation, untyped

from symaware_cli import Event, Tracks
from symaware_cli.engine.components.control.follow import Follow
from symaware_cli.engine.components.control.goal import GoToGoal
from symaware_cli.engine.components.perception import OmniscientPerception, SelfPerception
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.engine.runtime.failure import RunError
from symaware_cli.engine.runtime.run import run
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.language.build import build

FAST = Unicycle(Unicycle.Parameters(max_speed=2.0))


def led(
    offsets: Sequence[list[float]],
    goal: tuple[float, float] = (50.0, 0.0),
    model: NoisyModel | None = None,
    **parameters: Any,
) -> dict[str, Team]:
    """A leader at the origin that heads for its goal, and followers somewhere behind."""
    model = model or SingleIntegrator()
    rest = [0.0] * (len(model.state) - 2)
    leader = Team({"sense": SelfPerception, "steer": GoToGoal}, None, [[0.0, 0.0, *rest]], [{"goal": goal}], model)
    followers = Team(
        {"sense": OmniscientPerception, "steer": lambda: Follow(Follow.Parameters(leader="leader", **parameters))},
        len(offsets),
        [[-4.0, float(row), *rest] for row in range(len(offsets))],
        [{"offset": offset} for offset in offsets],
        model,
    )
    return {"leader": leader, "robot": followers}


def places_after(teams: Mapping[str, Any], steps: int) -> tuple[NDArray[np.float64], Simulation]:
    ready = simulation(teams)
    execute(ready, steps)
    positions = ready.environment.snapshot().positions
    return positions[1:, :2] - positions[0, :2], ready


@pytest.mark.parametrize("model", [SingleIntegrator(), FAST], ids=lambda m: type(m).__name__)
def test_followers_keep_their_offsets(model: NoisyModel) -> None:
    apart, _ = places_after(led([[-2.0, 1.0], [-2.0, -1.0]], model=model), 400)
    assert apart == pytest.approx(np.array([[-2, 1], [-2, -1]]), abs=0.1)


def test_an_offset_turns_with_the_motion_of_the_leader_or_stands_in_the_world() -> None:
    north: dict[str, Any] = {"goal": (0.0, 50.0)}
    assert places_after(led([[-2.0, 1.0]], **north), 400)[0] == pytest.approx(np.array([[-1, -2]]), abs=0.1)
    still = places_after(led([[-2.0, 1.0]], frame="world", **north), 400)[0]
    assert still == pytest.approx(np.array([[-2, 1]]), abs=0.1)


def test_a_leader_that_stands_keeps_the_direction_it_came_in() -> None:
    apart, ready = places_after(led([[-2.0, 1.0]], goal=(0.0, 3.0)), 400)
    assert np.abs(ready.environment.snapshot().velocities).max() < 0.01
    assert apart == pytest.approx(np.array([[-1, -2]]), abs=0.05)


@settings(max_examples=30)
@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(0.5, 3.0))
def test_a_follower_never_exceeds_its_speed(x: float, y: float, speed: float) -> None:
    ready = simulation(led([[x, y]], speed=speed))
    fastest = []
    ready.events.subscribe("stepped", lambda _: fastest.append(np.hypot(*ready.groups[1].control_input[0])))
    execute(ready, 40)
    assert max(fastest) <= speed * (1 + 1e-12)


def test_the_intent_leads_to_the_place_beside_the_leader() -> None:
    _, ready = places_after(led([[-2.0, 1.0]], horizon=10.0, samples=11), 100)
    intent = ready.groups[1].awareness.intent.row(0)
    leader = np.array([5.0, 0.0])  # it was at 4.95 m when the intent was made, 100 steps in
    assert intent.values[-1] == pytest.approx(leader + np.array([10.0 - 2.0, 1.0]), abs=0.1)


def test_an_agent_without_a_belief_about_the_leader_stops_with_one_event() -> None:
    teams = led([[-2.0, 1.0]])
    untyped(teams["robot"].components)["sense"] = SelfPerception
    ready = simulation(teams)
    told = []
    for name in Follow.events:
        ready.events.subscribe(name, lambda event: told.append((event.source, event.name)))
    ready.initialise()
    group, steer = ready.groups[1], ready.entries[-1].components[0]
    steer.compute_and_update()
    steer.compute_and_update()
    assert group.control_input.tolist() == [[0.0, 0.0]]
    assert told == [("agents.robot.0.steer", "leader-lost")]
    group.awareness.seen = Tracks.of(
        0, 1, np.array([0]), np.array([0]), np.array([[-1.0, 0.0]]), np.array([[0.5, 0.0]])
    )
    steer.compute_and_update()
    # From (-4, 0) to (-1, 0) + (-2, 1), beside the leader's own velocity: faster than it may.
    assert told[1:] == [("agents.robot.0.steer", "leader-found")]
    assert group.control_input[0] == pytest.approx(1.5 * np.array([1.5, 1.0]) / np.hypot(1.5, 1.0))


def test_a_velocity_that_may_well_be_none_has_no_direction() -> None:
    ready = simulation(led([[-2.0, 0.0]], goal=(0.0, 50.0)))
    ready.initialise()
    group, steer = ready.groups[1], ready.entries[-1].components[0]

    def turned_after(deviation: float) -> list[float]:
        square = np.diag([0.01, 0.01, deviation**2, deviation**2])[None]
        leader = np.array([[-2.0, 0.0]]), np.array([[0.0, 0.3]])
        group.awareness.seen = Tracks.of(0, 1, np.array([0]), np.array([0]), *leader, covariances=square)
        steer.compute_and_update()
        result: list[float] = group.control_input[0].tolist()
        return result

    assert turned_after(0.1) == pytest.approx([0.0, 0.3])  # behind the leader is still west of it
    assert turned_after(0.05) != pytest.approx([0.0, 0.3])  # now it is south


def test_a_leader_that_does_not_exist_is_named() -> None:
    teams = led([[-2.0, 1.0]])
    del teams["leader"]
    teams["other"] = Team({}, 1)
    with pytest.raises(RunError, match="`leader` names `leader`, which is no agent"):
        simulation(teams).initialise()


def test_six_keep_their_places_in_a_formation_by_noisy_beliefs_alone() -> None:
    built = build(CHECKOUT / "scenarios" / "formation.yaml", [], 3)
    simulation = built.simulation
    followers = next(group for group in simulation.groups if group.name == "follower")
    offsets = followers.known("offset")
    errors = []

    def look(_: Event) -> None:
        places, velocities = simulation.environment.snapshot().positions, simulation.environment.snapshot().velocities
        ahead = velocities[-1] / max(np.hypot(*velocities[-1]), 1e-9)
        turned = np.stack([offsets @ [ahead[0], -ahead[1]], offsets @ [ahead[1], ahead[0]]], axis=1)
        errors.append(np.hypot(*(places[:-1] - places[-1] - turned).T))

    simulation.events.subscribe("stepped", look)
    summary = run(simulation, 1400)
    assert summary.contacts == 0
    # On the straight; in the bends the outer ones fall behind.
    assert np.median(np.array(errors)[200:], axis=0).max() < 0.4


def test_nobody_follows_itself() -> None:
    group = Team({}, 2, knowledge=[{"offset": [0.0, 0.0]}] * 2).group("robot")
    with pytest.raises(ValueError, match="cannot follow itself"):
        Follow(Follow.Parameters(leader="robot.1")).check(group)
