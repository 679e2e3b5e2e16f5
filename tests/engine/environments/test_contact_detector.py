"""Contacts, against looking at every pair at every step."""

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from outlines import distance, placed, random_shape
from simulating import STEP, Team, simulate, simulation, untyped

from symaware_cli import (
    Box,
    Circle,
    Contact,
    Controller,
    Entity,
    Obstacle,
    Polygon,
    ScriptedPath,
    Shape,
    TimeSeries,
    Wall,
    open_log,
)
from symaware_cli.core import AgentGroup, Scenery, Snapshot
from symaware_cli.engine.environments.contact_detector import ContactDetector
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.geometry.proximity import Proximity
from symaware_cli.world.roster import Roster

DISC = Shape(circle=Circle(radius=0.5))
BOX = Shape(box=Box(length=2.0, width=0.5))
PLANE = SingleIntegrator(SingleIntegrator.Parameters())
SPACE = SingleIntegrator(SingleIntegrator.Parameters(dimensions=3))
UNICYCLE = Unicycle(Unicycle.Parameters())


class Run:
    """Groups and obstacles that a detector looks at, wherever a test puts them."""

    def __init__(
        self, groups: Sequence[tuple[NoisyModel, Any, int]], obstacles: dict[str, Any] | tuple[Any, ...] = ()
    ) -> None:
        """Each group is a model, a shape and the number of agents."""
        self.groups = [
            AgentGroup(
                name, [f"{name}.{row}" for row in range(count)], model, Entity(shape=shape), np.zeros((count, nx))
            )
            for name, (model, shape, count) in zip("abcdefgh", groups, strict=False)
            for nx in [len(model.state)]
        ]
        self.obstacles = dict(obstacles)
        self.roster = Roster({group.name: group.ids for group in self.groups})
        self.detector = ContactDetector(self.groups, Scenery(self.obstacles), Proximity())
        self.time = 0

    def put(self, *places: Any, time: int | None = None) -> Sequence[Contact]:
        """Put the groups where they are at the next time, and return what changes."""
        self.time = self.time + STEP if time is None else time
        states = [np.array(state, float) for state in places]
        models = [group.model for group in self.groups]
        inputs = [group.control_input for group in self.groups]
        snapshot = Snapshot(self.time, self.roster, models, states, inputs)
        return self.detector.update(snapshot, Scenery(self.obstacles, self.time))

    def bodies(
        self, states: Sequence[NDArray[np.float64]]
    ) -> Iterator[tuple[str, list[tuple[NDArray[np.float64], float]]]]:
        """The pieces of every body by name, agents first."""
        for group, rows in zip(self.groups, states, strict=True):
            for id, state in zip(group.ids, rows, strict=True):
                heading = 0.0 if group.model.heading is None else state[group.model.heading]
                yield id, placed(group.entity.shape, state[:2], heading) if group.entity.shape else []
        for name, obstacle in self.obstacles.items():
            pose = obstacle.pose(self.time / 1e9)
            yield name, placed(obstacle.shape, pose.position[:2], pose.heading)


def gap(one: Sequence[tuple[NDArray[np.float64], float]], other: Sequence[tuple[NDArray[np.float64], float]]) -> float:
    """The signed distance of two bodies."""
    return min((distance(piece, another) for piece in one for another in other), default=np.inf)


def a_crowd(random: np.random.Generator) -> Run:
    """Groups of all kinds, obstacles of all kinds, and a way for each to move."""
    groups = [
        (
            random.choice(untyped([UNICYCLE, PLANE])),
            shape,
            count,
        )
        for shape in random.permutation(untyped([random_shape(random), random_shape(random), DISC, None]))
        for count in random.integers(1, 5, 1).tolist()
    ]
    path = ScriptedPath(times=(0, 0.2, 1.1), positions=((-3, 0), (3, 1), (0, 0)), headings=(0, 2, -2), repeat=True)
    obstacles = {
        "box": Obstacle(shape=random_shape(random), position=tuple(random.uniform(-3, 3, 2)), heading=1.0),
        "cart": Obstacle(shape=random_shape(random), path=path),
        "wall": Obstacle(shape=Shape(wall=Wall(points=[(-4, -4), (4, -4), (4, 4), (0, 0)], thickness=0.3))),
    }
    return Run(groups, {name: each for name, each in obstacles.items() if random.random() < 0.7})


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_whoever_overlaps_is_in_contact_and_nobody_else(seed: int) -> None:
    random = np.random.default_rng(seed)
    run = a_crowd(random)
    states = [random.uniform(-4, 4, group.initial_state.shape) for group in run.groups]
    touching = {}
    for _ in range(12):
        changes = run.put(*states)
        assert changes == sorted(changes, key=lambda contact: (contact.first, contact.second))
        bodies = dict(run.bodies(states))
        for contact in changes:
            pair = contact.first, contact.second
            assert contact.first < contact.second
            assert contact.begins != (pair in touching), "a beginning and an end alternate"
            if contact.begins:
                touching[pair] = contact
                apart = gap(*(bodies[name] for name in pair))
                assert contact.depth == pytest.approx(-apart, abs=1e-9) or contact.depth < -apart
                for name in pair:
                    point = [(np.array([contact.point]), 0.0)]
                    assert gap(point, bodies[name]) <= contact.depth / 2 + 1e-9, "the point lies on both"
            else:
                del touching[pair]
        agents = len(run.roster)
        for one, other in itertools.combinations(bodies, 2):
            if list(bodies).index(one) >= agents:
                continue
            apart = gap(bodies[one], bodies[other])
            assert (tuple(sorted((one, other))) in touching) == (apart < 0.0) or abs(apart) < 1e-9
        states = [state + random.normal(scale=0.7, size=state.shape) for state in states]


def test_a_contact_is_reported_at_its_beginning_and_end_only() -> None:
    run = Run([(PLANE, DISC, 2)])
    places = [3.0, 1.2, 0.8, 0.5, 0.9, 1.0, 1.5, 0.9]
    told = [[contact.begins for contact in run.put([[0, 0], [x, 0]])] for x in places]
    assert told == [[], [], [True], [], [], [False], [], [True]]


def test_two_discs_touch_in_the_middle_of_their_overlap() -> None:
    run = Run([(PLANE, DISC, 2)])
    (contact,) = run.put([[0, 0], [0.6, 0]])
    assert contact.point == pytest.approx((0.3, 0.0))
    assert contact.depth == pytest.approx(0.4)
    (contact,) = Run([(PLANE, DISC, 2)]).put([[1, 1], [1, 1]])
    assert (contact.point, contact.depth) == ((1.0, 1.0), 1.0)


def test_a_long_wall_is_touched_where_the_agent_is() -> None:
    wall = Obstacle(shape=Shape(box=Box(length=100.0, width=1.0)), position=(0, 0))
    run = Run([(PLANE, BOX, 1)], {"wall": wall})
    (contact,) = run.put([[30.0, 0.65]])
    assert contact.point == pytest.approx((30.0, 0.45))
    assert contact.depth == pytest.approx(0.1)


def test_a_box_turns_with_the_heading_of_its_model_and_not_without() -> None:
    across = [0.0, 0.0, np.pi / 2]
    turned = Run([(UNICYCLE, BOX, 1), (UNICYCLE, DISC, 1)])
    assert not turned.put([across], [[1.0, 0.0, 0.0]])
    assert turned.put([across], [[0.0, 1.2, 0.0]])
    still = Run([(PLANE, BOX, 1), (UNICYCLE, DISC, 1)])
    assert still.put([[0.0, 0.0]], [[1.0, 0.0, 0.0]])


def test_an_agent_without_a_shape_touches_nothing() -> None:
    run = Run(
        [(UNICYCLE, None, 2), (UNICYCLE, DISC, 1)],
        {"box": Obstacle(shape=BOX, position=(0, 0))},
    )
    assert [contact.first for contact in run.put(np.zeros((2, 3)), np.zeros((1, 3)))] == ["b.0"]


def test_obstacles_touch_agents_and_not_each_other() -> None:
    run = Run(
        [(UNICYCLE, DISC, 1)],
        {"one": Obstacle(shape=BOX, position=(0, 0)), "other": Obstacle(shape=DISC, position=(0, 0))},
    )
    assert not run.put([[9, 9, 0]])
    assert [contact.first for contact in run.put([[0, 0, 0]])] == ["a.0", "a.0"]


def test_a_wall_is_one_body_however_many_segments_of_it_are_touched() -> None:
    wall = Obstacle(shape=Shape(wall=Wall(points=[(0, 0), (2, 0), (2, 2)], thickness=0.2)))
    run = Run([(UNICYCLE, DISC, 1)], {"wall": wall})
    (contact,) = run.put([[1.7, 0.5, 0]])
    assert contact.depth == pytest.approx(0.3), "the deepest"
    assert contact.point == pytest.approx((2.05, 0.5))
    assert run.put([[1.7, 0.7, 0]]) == [], "it passes from one segment to the other"


def test_in_space_round_agents_are_balls_and_obstacles_as_high_as_the_world() -> None:
    run = Run(
        [(SPACE, DISC, 2), (SPACE, BOX, 1)],
        {"post": Obstacle(shape=DISC, position=(50, 0))},
    )
    assert not run.put([[0, 0, 0], [0, 0, 1.1]], [[9, 9, 9]])
    (contact,) = run.put([[0, 0, 0], [0, 0, 0.8]], [[9, 9, 9]])
    assert contact.point == pytest.approx((0, 0, 0.4))
    changes = run.put([[50, 0, 7.0], [0, 0, 0.8]], [[0, 0, 0.8]])
    assert [(each.first, each.second, each.begins) for each in changes] == [
        ("a.0", "a.1", False),
        ("a.0", "post", True),
        ("a.1", "b.0", True),
    ]
    assert changes[1].point == pytest.approx((50.0, 0.0, 7.0))


class Right(Controller):
    """Goes to the right at 1 m/s."""

    def _compute(self) -> tuple[NDArray[np.float64], TimeSeries]:
        return np.array([1.0, 0.0]), TimeSeries()

    def _update(self, value: tuple[NDArray[np.float64], TimeSeries]) -> None:
        self._agent.model.control_input, self._agent.self_awareness.intent = value


def cart(**path: bool) -> Obstacle:
    return Obstacle(shape=DISC, path=ScriptedPath(times=(0.0, 1.0), positions=((0, 0), (10, 0)), **path))


def test_bodies_that_overlap_at_the_start_are_in_contact_at_time_zero(tmp_path: Path) -> None:
    triangle = Shape(polygon=Polygon(vertices=[(-1, -1), (1, -1), (0, 1)]))
    teams = {
        "robot": Team({"steer": Right}, count=2, state=[[0, 0], [0.5, 0]], entity=Entity(shape=triangle)),
    }
    simulate(teams, obstacles={"post": Obstacle(shape=DISC, position=(1.4, 0))}, log=tmp_path / "run.mcap")
    contacts = list(open_log(tmp_path / "run.mcap").contacts())
    assert [(each.a, each.b, each.time) for each in contacts if each.time == 0] == [
        ("post", "robot.1", 0),
        ("robot.0", "robot.1", 0),
    ]


def test_a_moving_obstacle_meets_those_in_its_way() -> None:
    ready = simulation({"robot": Team(state=[[5.0, 0.0]], entity=Entity(shape=DISC))}, obstacles={"cart": cart()})
    told = []
    for _ in range(20):
        told += [(ready.environment.snapshot().time, each.begins) for each in ready.environment.contacts()]
        ready.environment.step()
    # It comes at 10 m/s, 0.5 m a step: at 4.5 m after 9 steps they overlap, at 6 m after 12 they only touch.
    assert told == [(9 * STEP, True), (12 * STEP, False)]


@pytest.mark.parametrize("repeat", [False, True])
def test_a_moving_obstacle_is_where_its_path_says_and_the_log_tells(tmp_path: Path, repeat: bool) -> None:
    obstacles = {"cart": cart(repeat=repeat), "post": Obstacle(shape=DISC, position=(5, 5), heading=0.5)}
    simulate({"robot": Team()}, 30, obstacles=obstacles, log=tmp_path / "run.mcap")
    log = open_log(tmp_path / "run.mcap")
    series = log.series("cart", "world")
    assert series.columns == ("x", "y", "heading")
    assert series.units == ("m", "m", "rad")
    steps = np.arange(31 if repeat else 21)  # once at rest it is not recorded again
    assert series.times.tolist() == (steps * STEP).tolist()
    np.testing.assert_allclose(series.values[:, 0], 10 * (steps * 0.05 % 1.0 if repeat else steps * 0.05), atol=1e-9)
    np.testing.assert_array_equal(series.values[:, 1:], 0.0)
    assert "/world/post/state" not in log.channels, "what stands still is in the manifest"
    post = log.manifest["entities"]["post"]
    assert (post["shape"], post["position"], post["heading"]) == ({"circle": {"radius": 0.5}}, [5.0, 5.0], 0.5)
    assert log.manifest["entities"]["cart"]["position"] == [0.0, 0.0]


def test_an_obstacle_that_moves_in_space_is_recorded_with_its_height(tmp_path: Path) -> None:
    path = ScriptedPath(times=(0, 1), positions=((0, 0, 1), (0, 0, 2)), headings=(0, 1))
    simulate({"robot": Team()}, 20, obstacles={"lift": Obstacle(shape=DISC, path=path)}, log=tmp_path / "run.mcap")
    series = open_log(tmp_path / "run.mcap").series("lift", "world")
    assert series.columns == ("x", "y", "z", "heading")
    np.testing.assert_allclose(series.values[-1], [0, 0, 2, 1])
