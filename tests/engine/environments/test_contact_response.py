"""What contacts do in the kinematic world."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import made

from symaware_cli import Box, Circle, Entity, Obstacle, ScriptedPath, Shape, Wall, scenario
from symaware_cli.core import AgentGroup, WorldError
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.geometry import BodyOutlines, separation

DISC = Shape(circle=Circle(radius=0.5))
WALL = Obstacle(shape=Shape(wall=Wall(points=((2.0, -9.0), (2.0, 9.0)), thickness=0.2)), position=(0.0, 0.0))


def team(
    states: Sequence[Sequence[float]] | NDArray[np.float64],
    inputs: Sequence[Sequence[float]] | NDArray[np.float64],
    model: Any = None,
    shape: Shape = DISC,
    name: str = "robot",
) -> AgentGroup:
    """Agents with constant control inputs."""
    ids = [f"{name}.{row}" for row in range(len(states))]
    model = model or made(SingleIntegrator)
    group = AgentGroup(name, ids, model, Entity(shape=shape), np.array(states, float))
    group.control_input = np.array(inputs, float)
    return group


def world(on_contact: str, *groups: AgentGroup, obstacles: Any = (), time_step: float = 0.1) -> KinematicEnvironment:
    """A world with some obstacles."""
    environment = made(KinematicEnvironment, on_contact=on_contact, time_step=time_step)
    environment.initialise(groups, dict(obstacles), 1)
    return environment


def run(environment: KinematicEnvironment, steps: int) -> tuple[list[NDArray[np.float64]], list[tuple[int, bool]]]:
    """Return the final states of each group, and the number and kind of each change of contacts."""
    contacts = []
    for number in range(steps):
        environment.step()
        contacts += [(number, each.begins) for each in environment.contacts()]
    return [environment.state(group) for group in environment.groups], contacts


def test_a_body_stops_in_front_of_a_wall_and_the_contact_is_reported_once() -> None:
    (state,), contacts = run(world("stop", team([[0.05, 0.0]], [[1.0, 0.2]]), obstacles={"wall": WALL}), 40)
    assert np.allclose(state, [[1.35, 0.26]])
    assert contacts == [(13, True)]


def test_a_body_slides_along_a_wall_with_the_velocity_that_leads_along_it() -> None:
    (state,), contacts = run(world("slide", team([[0.05, 0.0]], [[1.0, 0.2]]), obstacles={"wall": WALL}), 40)
    assert np.allclose(state, [[1.4, 0.8]], atol=1e-6)
    assert contacts == [(13, True)]


def test_by_default_bodies_pass_through_each_other() -> None:
    environment = made(KinematicEnvironment, time_step=0.1)
    environment.initialise([team([[0.0, 0.0]], [[1.0, 0.2]])], {"wall": WALL}, 1)
    (state,), contacts = run(environment, 40)
    assert np.allclose(state, [[4.0, 0.8]])
    assert [begins for _, begins in contacts] == [True, False]


def test_the_contact_ends_once_the_body_moves_away() -> None:
    group = team([[1.35, 0.0]], [[1.0, 0.0]])
    environment = world("stop", group, obstacles={"wall": WALL})
    run(environment, 5)
    group.control_input = np.array([[-1.0, 0.0]])
    (state,), contacts = run(environment, 5)
    assert contacts == [(0, False)]
    assert np.allclose(state, [[0.85, 0.0]])


@pytest.mark.parametrize("kind", ["stop", "slide"])
def test_two_that_meet_head_on_stay_apart(kind: str) -> None:
    (state,), contacts = run(world(kind, team([[0.0, 0.0], [3.0, 0.0]], [[1.0, 0.0], [-1.0, 0.0]])), 30)
    assert state[1, 0] - state[0, 0] >= 1.0 - 1e-9
    assert state[0, 0] == pytest.approx(1.0, abs=0.11)
    assert [begins for _, begins in contacts] == [True]


def test_one_that_runs_into_a_slower_one_does_not_stop_it() -> None:
    (state,), _ = run(world("stop", team([[0.0, 0.0], [1.5, 0.0]], [[1.0, 0.0], [0.5, 0.0]])), 40)
    assert state[1, 0] == pytest.approx(3.5)
    assert state[0, 0] <= 2.5 + 1e-9


def test_sliding_discs_pass_each_other() -> None:
    (state,), contacts = run(world("slide", team([[0.0, 0.1], [3.0, -0.1]], [[1.0, 0.0], [-1.0, 0.0]])), 80)
    assert state[0, 0] > 3.0
    assert state[1, 0] < 0.0
    assert [begins for _, begins in contacts] == [True, False]


def test_a_velocity_in_the_state_is_lost_in_the_direction_of_the_wall_only() -> None:
    model = made(DoubleIntegrator)
    start, nothing = [[0.0, 0.0, 1.0, 0.5]], [[0.0, 0.0]]
    (stopped,), _ = run(world("stop", team(start, nothing, model), obstacles={"wall": WALL}), 40)
    (slid,), _ = run(world("slide", team(start, nothing, model), obstacles={"wall": WALL}), 40)
    assert stopped[0, 2:].tolist() == [0.0, 0.0]
    assert np.allclose(slid[0, 2:], [0.0, 0.5])
    assert slid[0, 1] == pytest.approx(2.0)


def test_a_moving_obstacle_pushes_a_sliding_body_along() -> None:
    cart = Obstacle(shape=DISC, path=ScriptedPath(times=(0.0, 10.0), positions=((-2.0, 0.0), (8.0, 0.0))))
    (state,), _ = run(world("slide", team([[0.0, 0.0]], [[0.0, 0.0]]), obstacles={"cart": cart}), 50)
    assert state[0, 0] == pytest.approx(4.0, abs=1e-6)


def test_bodies_that_overlap_at_the_start_may_part() -> None:
    (state,), _ = run(world("stop", team([[0.0, 0.0], [0.5, 0.0]], [[-1.0, 0.0], [0.0, 0.0]])), 10)
    assert np.allclose(state, [[-1.0, 0.0], [0.5, 0.0]])


@pytest.mark.parametrize("kind", ["stop", "slide"])
@pytest.mark.parametrize("seed", range(4))
def test_in_a_crowd_no_body_ever_overlaps_another_that_it_did_not_overlap(kind: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0)), -1).reshape(-1, 2) * 2.0
    box = Shape(box=Box(length=1.0, width=0.4))
    cars = team(
        np.column_stack([grid[:8], random.uniform(-3, 3, 8)]),
        random.uniform(-1, 1, (8, 2)),
        made(Unicycle),
        box,
        "car",
    )
    discs = team(grid[8:], random.uniform(-1, 1, (8, 2)))
    walls = {
        f"wall_{number}": Obstacle(shape=Shape(wall=Wall(points=points, thickness=0.2)), position=(0.0, 0.0))
        for number, points in enumerate(
            [((-1, -1), (7, -1)), ((7, -1), (7, 7)), ((7, 7), (-1, 7)), ((-1, 7), (-1, -1))]
        )
    }
    environment = world(kind, cars, discs, obstacles=walls)
    kinds = BodyOutlines([box.pieces[0], DISC.pieces[0]], [8, 8])
    first, second = np.triu_indices(16, 1)
    for _ in range(40):
        environment.step()
        snapshot = environment.snapshot()
        bodies = kinds.placed(np.arange(16), snapshot.positions, snapshot.headings)
        assert separation(bodies.take(first), bodies.take(second)).distance.min() > -1e-6
        scenery = environment.scenery
        one, piece = np.divmod(np.arange(16 * len(scenery.pieces)), len(scenery.pieces))
        assert separation(bodies.take(one), scenery.pieces.take(piece)).distance.min() > -1e-6


def test_proofs_about_motion_do_not_hold_where_contacts_change_it() -> None:
    group = team([[0.0, 0.0]], [[0.0, 0.0]])
    with pytest.raises(WorldError, match="do not move as their models say"):
        world("slide", group).drive(group)


SCENARIO = {
    "symaware": 1,
    "name": "bump",
    "environment": {
        "use": "kinematic",
        "with": {"time_step": 0.1},
        "entities": {"pillar": {"shape": {"circle": {"radius": 0.5}}, "position": [2.05, 0.4]}},
    },
    "run": {"duration": 8.0},
    "agents": {
        "robot": {
            "entity": {"shape": {"circle": {"radius": 0.5}}},
            "model": {"use": "single-integrator"},
            "state": [0.0, 0.0],
            "knowledge": {"goal": [5.0, 0.0]},
            "components": {"sense": {"use": "perception.self"}, "drive": {"use": "control.go-to-goal"}},
        }
    },
}


@pytest.mark.parametrize(
    ("kind", "said", "time", "goals"),
    [
        ("pass", "1, bodies pass through each other", 8.0, 1),
        ("stop", "1, bodies stop", 8.0, 0),
        ("slide", "1, bodies slide along each other", 8.0, 1),
        ("end", "1, the first ends the run", 1.2, 0),
    ],
)
def test_the_summary_has_the_effects_of_contacts(kind: str, said: str, time: float, goals: int) -> None:
    result = scenario(SCENARIO, {"environment.with.on_contact": kind}).run(record=False)
    assert f"contacts       {said}" in str(result)
    assert result.summary.simulated_time == pytest.approx(time)
    assert result.summary.on_contact == kind
    assert len(result.summary.goals_reached) == goals
