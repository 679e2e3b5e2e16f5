"""Perception with a range, a field of view, walls, errors, a delay and gaps, against geometry by brute force."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from simulating import STEP, Team, present, simulation

from symaware_cli import AgentGroup, Entity, Obstacle
from symaware_cli.engine.components.perception_range import RangePerception
from symaware_cli.engine.environments.column_environment import ColumnEnvironment
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.engine.runtime.simulation import Simulation


def sense(**parameters: Any) -> dict[str, Callable[..., Any]]:
    return {"sense": lambda: RangePerception(RangePerception.Parameters(**parameters))}


def begun(teams: Mapping[str, Any], **options: Any) -> Simulation:
    """A simulation whose components have taken up their work."""
    ready = simulation(teams, **options)
    ready.initialise()
    return ready


def turn(ready: Simulation) -> None:
    for entry in ready.entries:
        for component in entry.components:
            component.compute_and_update()


def step(ready: Simulation) -> None:
    ready.environment.step()
    ready.clock.now += ready.environment.time_step


def group_of(ready: Simulation, name: str = "robot") -> AgentGroup:
    return next(group for group in ready.groups if group.name == name)


def seen_by(group: AgentGroup) -> set[tuple[int, int]]:
    """Whom each agent of a group sees: pairs of a row and an index in the roster."""
    tracks = group.awareness.tracks
    assert tracks is not None
    return set(zip(tracks.observers.tolist(), tracks.others.tolist(), strict=True))


# --- whom one sees ----------------------------------------------------------------------------------------------------


def distance_to_segment(point: NDArray[np.float64], one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    along = other - one
    length = along @ along
    share = np.clip((point - one) @ along / length, 0.0, 1.0) if length else 0.0
    return float(np.linalg.norm(one + share * along - point))


def is_cut_by_box(
    one: NDArray[np.float64],
    other: NDArray[np.float64],
    centre: tuple[float, float],
    heading: float,
    extent: NDArray[np.float64],
) -> int:
    """Whether a segment passes through the inside of a box, by clipping it (Liang and Barsky, 1984)."""
    turn_back = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    one, other = turn_back @ (one - centre), turn_back @ (other - centre)
    first, last = 0.0, 1.0
    for axis in range(2):
        along, half = other[axis] - one[axis], extent[axis] / 2
        if abs(along) < 1e-15:
            if abs(one[axis]) >= half:
                return False
            continue
        crossings = sorted(((-half - one[axis]) / along, (half - one[axis]) / along))
        first, last = max(first, crossings[0]), min(last, crossings[1])
    return first < last


@st.composite
def scenes(draw: Callable[..., Any]) -> dict[str, Any]:
    seed = draw(st.integers(0, 2**32 - 1))
    chance = np.random.default_rng(seed)
    count = draw(st.sampled_from([1, 2, 5, 30, 80]))
    extent = draw(st.sampled_from([2.0, 10.0, 40.0]))
    return {
        "state": np.column_stack([chance.uniform(0, extent, (count, 2)), chance.uniform(-20, 20, count)]),
        "bystanders": chance.uniform(0, extent, (draw(st.integers(0, 4)), 2)),
        "range": draw(st.floats(0.5, 30.0)),
        "field_of_view": draw(st.one_of(st.none(), st.floats(0.05, 2 * math.pi))),
        "circles": chance.uniform((0, 0, 0.1), (extent, extent, 2.0), (draw(st.integers(0, 3)), 3)),
        "boxes": chance.uniform((0, 0, -4, 0.1, 0.1), (extent, extent, 4, 5, 2), (draw(st.integers(0, 3)), 5)),
    }


def brute_force(
    scene: Mapping[str, Any], positions: NDArray[np.float64], row: int, index: int
) -> tuple[np.bool_, np.bool_]:
    """Whether an agent sees another, and whether rounding might see it otherwise."""
    one, other, heading = positions[row], positions[index], scene["state"][row, 2]
    away = other - one
    distance = np.linalg.norm(away)
    seen, doubtful = distance <= scene["range"], abs(distance - scene["range"]) < 1e-9
    if scene["field_of_view"] is not None:
        off = abs(np.angle(np.exp(1j * (math.atan2(away[1], away[0]) - heading))))
        seen &= off <= scene["field_of_view"] / 2
        doubtful |= abs(off - scene["field_of_view"] / 2) < 1e-6
    for x, y, radius in scene["circles"]:
        clearance = distance_to_segment(np.array([x, y]), one, other) - radius
        seen &= clearance >= 0
        doubtful |= abs(clearance) < 1e-9
    for x, y, turned, length, width in scene["boxes"]:
        cuts = [is_cut_by_box(one, other, (x, y), turned, np.array([length, width]) + by) for by in (-2e-9, 0, 2e-9)]
        seen &= not cuts[1]
        doubtful |= len(set(cuts)) > 1
    return seen, doubtful


@given(scenes())
@settings(max_examples=60)
def test_an_agent_sees_exactly_the_agents_in_its_field_of_view(scene: dict[str, Any]) -> None:
    obstacles = {
        **{
            f"circle{number}": Obstacle(shape={"circle": {"radius": radius}}, position=(x, y))
            for number, (x, y, radius) in enumerate(scene["circles"])
        },
        **{
            f"box{number}": Obstacle(
                shape={"box": {"length": length, "width": width}}, position=(x, y), heading=heading
            )
            for number, (x, y, heading, length, width) in enumerate(scene["boxes"])
        },
    }
    watchers = Team(
        sense(range=scene["range"], field_of_view=scene["field_of_view"], occlusion=True),
        count=len(scene["state"]),
        state=scene["state"].tolist(),
        model=Unicycle(),
    )
    # Others stand before and after the watchers in the roster.
    others = len(scene["bystanders"])
    bystanders = Team(count=others, state=scene["bystanders"].tolist())
    teams = {"robot": watchers} | ({"a": bystanders, "z": bystanders} if others else {})
    ready = begun(teams, obstacles=obstacles)
    turn(ready)
    positions = ready.environment.snapshot().positions
    start, seen = ready.environment.roster.start("robot"), seen_by(group_of(ready))
    assert start == others
    # As the brute force numbers them: watchers, then those after them, then those before.
    positions = np.roll(positions, -start, axis=0)
    for row in range(0, len(scene["state"]), 1 + len(scene["state"]) // 8):
        for index in range(len(positions)):
            is_seen = (row, (index + start) % len(positions)) in seen
            if index == row:
                assert not is_seen
                continue
            expected, doubtful = brute_force(scene, positions, row, index)
            assert doubtful or is_seen == expected


@given(st.integers(0, 2**32 - 1), st.floats(0.5, 6.0))
@settings(max_examples=25)
def test_detections_without_errors_are_the_truth(seed: int, reach: float) -> None:
    chance = np.random.default_rng(seed)
    state = chance.uniform(0, 5, (20, 2))
    ready = begun({"robot": Team(sense(range=reach), count=20, state=state.tolist())})
    group = group_of(ready)
    group.control_input = chance.uniform(-1, 1, (20, 2))
    step(ready)
    turn(ready)
    world, awareness = ready.environment.snapshot(), group.awareness
    assert np.array_equal(awareness.state, world.states[0])
    assert awareness.tracks is not None
    assert np.array_equal(awareness.tracks.positions, world.positions[awareness.tracks.others])
    assert np.array_equal(awareness.tracks.velocities, world.velocities[awareness.tracks.others])
    assert not awareness.tracks.ages.any()
    assert awareness.observation is not None
    assert awareness.observation.tracks is awareness.tracks
    assert awareness.observation.time == awareness.tracks.time == ready.clock.now


def test_nothing_that_is_seen_shares_memory_with_the_world() -> None:
    ready = begun({"robot": Team(sense(range=5.0), count=3)})
    turn(ready)
    world, awareness = ready.environment.snapshot(), group_of(ready).awareness
    assert awareness.observation is not None
    assert awareness.tracks is not None
    for own in (awareness.state, awareness.observation.state, awareness.tracks.positions, awareness.tracks.velocities):
        assert own is not None
        assert not own.flags.writeable
        for theirs in (world.states[0], world.positions, world.velocities):
            assert not np.shares_memory(own, theirs)


def test_an_agent_out_of_sight_is_forgotten_at_once() -> None:
    still = Team(sense(range=1.0), state=[[0.0, 0.0]])
    ready = begun({"robot": still, "visitor": Team(state=[[0.9, 0.0]])})
    turn(ready)
    assert len(present(group_of(ready).awareness.tracks)) == 1
    group_of(ready, "visitor").control_input = [[10.0, 0.0]]
    step(ready)
    turn(ready)
    assert len(present(group_of(ready).awareness.tracks)) == 0


def test_agents_of_the_plane_and_of_space_see_each_other() -> None:
    plane = Team(sense(range=4.0), count=2, state=[[0, 0], [1, 0]])
    space = Team(sense(range=4.0), state=[[0, 0, 3]], model=SingleIntegrator(SingleIntegrator.Parameters(dimensions=3)))
    ready = begun({"robot": plane, "drone": space})
    turn(ready)
    assert present(group_of(ready).awareness.tracks).positions.tolist() == [[0, 0, 3], [1, 0, 0], [0, 0, 3], [0, 0, 0]]
    assert present(group_of(ready, "drone").awareness.tracks).positions.tolist() == [[0, 0, 0], [1, 0, 0]]
    # Of those in sight, the ones within reach; the drone is sqrt(10) m away from the second robot.
    assert len(group_of(ready).others(3.0)) == 3


# --- errors -----------------------------------------------------------------------------------------------------------


def crowd(count: int, **parameters: Any) -> Simulation:
    """Agents in one place, all in sight of each other."""
    return begun({"robot": Team(sense(range=1.0, **parameters), count=count, state=[[0.5, -0.5]] * count)})


def is_normal(errors: NDArray[np.float64], deviation: float) -> np.bool_:
    """Whether many errors may well be normal with a mean of zero; each bound is off by chance once in 15,000 times."""
    errors = errors.ravel() / deviation
    count = len(errors)
    # Standard errors of mean, variance and fourth moment of a normal distribution: 1, 2 and 96 over the count.
    result: np.bool_ = (
        abs(errors.mean()) < 4 / math.sqrt(count)
        and abs((errors**2).mean() - 1) < 4 * math.sqrt(2 / count)
        and abs((errors**4).mean() - 3) < 4 * math.sqrt(96 / count)
    )
    return result


def test_errors_are_normal_and_independent_of_each_other_with_the_deviations_given() -> None:
    ready = crowd(60, position_noise=0.2, velocity_noise=0.03, self_noise=(0.1, 0.0))
    awareness = group_of(ready).awareness
    parts = []
    for _ in range(20):
        turn(ready)
        assert awareness.tracks is not None
        parts.append(np.hstack([awareness.tracks.positions - (0.5, -0.5), awareness.tracks.velocities]))
        assert (awareness.state[:, 1] == -0.5).all()
    errors = np.concatenate(parts)
    assert len(errors) == 20 * 60 * 59
    assert is_normal(errors[:, :2], 0.2)
    assert is_normal(errors[:, 2:], 0.03)
    correlation = np.corrcoef(errors.T) - np.eye(4)
    assert np.abs(correlation).max() < 4 / math.sqrt(len(errors))
    # From one turn to the next, too.
    follow = np.corrcoef(np.concatenate(parts[:-1])[:, 0], np.concatenate(parts[1:])[:, 0])[0, 1]
    assert abs(follow) < 4 / math.sqrt(19 * 60 * 59)


def test_errors_of_the_own_state_are_normal_with_the_deviation_of_each_element() -> None:
    team = Team(sense(range=1.0, self_noise=[0.3, 0.02, 0.1]), count=100, model=Unicycle())
    ready = begun({"robot": team})
    group = group_of(ready)
    errors = []
    for _ in range(100):
        turn(ready)
        errors.append(group.awareness.state - group.initial_state)
    for element, deviation in enumerate((0.3, 0.02, 0.1)):
        assert is_normal(np.array(errors)[:, :, element], deviation)
    assert group.awareness.observation is not None
    assert group.awareness.observation.state_deviation.tolist() == [0.3, 0.02, 0.1]


def test_one_number_is_the_deviation_of_every_element() -> None:
    ready = crowd(2, self_noise=0.4)
    turn(ready)
    assert present(group_of(ready).awareness.observation).state_deviation.tolist() == [0.4, 0.4]


@pytest.mark.parametrize("dropout", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_as_many_are_missed_as_the_dropout_says(dropout: float) -> None:
    ready = crowd(50, dropout=dropout)
    seen, turns, possible = 0, 20, 50 * 49
    for _ in range(turns):
        turn(ready)
        seen += len(present(group_of(ready).awareness.tracks))
    missed = 1 - seen / (turns * possible)
    assert abs(missed - dropout) <= 4 * math.sqrt(dropout * (1 - dropout) / (turns * possible))


# --- whose chance -----------------------------------------------------------------------------------------------------

NOISY = {
    "range": 4.0,
    "field_of_view": 4.0,
    "position_noise": 0.1,
    "velocity_noise": 0.2,
    "self_noise": 0.05,
    "dropout": 0.3,
}


def perceived(
    teams: Mapping[str, Any], steps: int = 6, groups: tuple[str, str] = ("robot", "other")
) -> list[tuple[bytes, list[tuple[Any, Any]], bytes, bytes]]:
    """What the groups that matter perceive over a few steps, by id, as bytes."""
    ready = begun(teams)
    roster, told = ready.environment.roster, []
    for _ in range(steps):
        turn(ready)
        for name in groups:
            awareness = group_of(ready, name).awareness
            tracks = awareness.tracks
            assert tracks is not None
            told.append(
                (
                    awareness.state[:6].tobytes(),
                    [
                        (row, roster.ids[other])
                        for row, other in zip(present(tracks).observers, present(tracks).others, strict=True)
                        if row < 6
                    ],
                    tracks.positions[tracks.observers < 6].tobytes(),
                    tracks.velocities[tracks.observers < 6].tobytes(),
                )
            )
            group_of(ready, name).control_input = np.full((len(group_of(ready, name)), 2), 0.5)
        step(ready)
    return told


@pytest.fixture
def neighbours() -> dict[str, Team]:
    chance = np.random.default_rng(3)
    state = np.column_stack([chance.uniform(0, 5, (12, 2)), chance.uniform(-3, 3, 12)]).tolist()
    robots = Team(sense(**NOISY), count=6, state=state[:6], model=Unicycle())
    return {"robot": robots, "other": replace(robots, state=state[6:])}


def test_agents_far_away_change_nothing_for_anybody(neighbours: dict[str, Any]) -> None:
    expected = perceived(neighbours)
    far = [[1000.0, 1000.0, 0.0], [1001.0, 1000.0, 0.0]]
    more = replace(neighbours["robot"], count=8, state=[*neighbours["robot"].state, *far])
    assert perceived({**neighbours, "robot": more}) == expected
    visitors = replace(neighbours["robot"], count=2, state=far)
    assert perceived({**neighbours, "a": visitors, "pair": visitors}) == expected
    # So many that pairs are found by a tree.
    many = replace(neighbours["robot"], count=90, state=[[1e4 + row, 0.0, 0.0] for row in range(90)])
    assert perceived({**neighbours, "many": many}) == expected


def test_the_order_of_groups_changes_nothing(neighbours: dict[str, Any]) -> None:
    assert perceived(dict(reversed(neighbours.items()))) == perceived(neighbours)


def test_a_visitor_changes_nothing_for_agents_that_do_not_see_it(neighbours: dict[str, Any]) -> None:
    state = np.array([*neighbours["robot"].state, *neighbours["other"].state])
    state[:, :2] *= 100
    spread = {
        "robot": replace(neighbours["robot"], state=state[:6].tolist()),
        "other": replace(neighbours["other"], state=state[6:].tolist()),
    }
    visitor = Team(state=[(state[5, :2] + 0.5 * np.array([math.cos(state[5, 2]), math.sin(state[5, 2])])).tolist()])
    alone, visited = perceived(spread), perceived({**spread, "visitor": visitor})
    assert visited != alone
    for one, other in zip(alone, visited, strict=True):
        # Whoever sees the visitor, the last robot, draws for it and so draws otherwise afterwards.
        but_the_last = slice(0, 5 * 3 * 8)
        assert one[0][but_the_last] == other[0][but_the_last]
        assert {row for row, _ in one[1]} <= {row for row, _ in other[1]} <= {5}


# --- delay ------------------------------------------------------------------------------------------------------------


@given(st.integers(0, 7), st.floats(-0.49, 0.49), st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_late_detections_equal_the_world_of_that_time_to_the_bit(steps: int, odd: float, seed: int) -> None:
    assume(steps + odd >= 0)
    chance = np.random.default_rng(seed)
    team = Team(
        sense(range=3.0, delay=(steps + odd) * STEP / 1e9), count=5, state=chance.uniform(0, 3, (5, 2)).tolist()
    )
    ready = begun({"robot": team})
    group, past = group_of(ready), []
    for number in range(12):
        past.append(ready.environment.snapshot())
        turn(ready)
        observation = group.awareness.observation
        assert observation is not None
        assert observation.time == ready.clock.now - steps * STEP
        if number < steps:
            assert observation is not None
            assert observation.state is None
            assert group.awareness.tracks is not None
            assert len(group.awareness.tracks) == 0
            assert np.array_equal(group.awareness.state, group.initial_state)
        else:
            then, tracks = past[number - steps], group.awareness.tracks
            assert tracks is not None
            assert then.time == observation.time == tracks.time
            assert np.array_equal(group.awareness.state, then.states[0])
            apart = np.linalg.norm(then.positions[:, None] - then.positions[None], axis=2)
            assert seen_by(group) == set(zip(*np.nonzero((apart <= 3.0) & ~np.eye(5, dtype=bool)), strict=True))
            assert np.array_equal(tracks.positions, then.positions[tracks.others])
            assert np.array_equal(tracks.velocities, then.velocities[tracks.others])
            assert not tracks.ages.any()
        group.control_input = chance.uniform(-20, 20, (5, 2))
        step(ready)


def test_a_moving_wall_hides_agents_by_its_position_at_that_time() -> None:
    path = {"times": [0.0, 5 * STEP / 1e9], "positions": [[0.0, 10.0], [0.0, 0.0]]}
    wall = Obstacle(shape={"box": {"length": 0.2, "width": 1.0}}, path=path)
    pair = Team(sense(range=9.0, occlusion=True, delay=3 * STEP / 1e9), count=2, state=[[-2, 0], [2, 0]])
    ready = begun({"robot": pair}, obstacles={"wall": wall})
    seen = []
    for _ in range(12):
        turn(ready)
        seen.append(len(present(group_of(ready).awareness.tracks)))
        step(ready)
    # The wall is between them from the fifth step on, which is seen three steps later; before there is nothing to see.
    assert seen == [0] * 3 + [2] * 5 + [0] * 4


def test_without_occlusion_walls_hide_nobody() -> None:
    wall = Obstacle(shape={"box": {"length": 0.2, "width": 9.0}}, position=(0, 0))
    ready = begun({"robot": Team(sense(range=9.0), count=2, state=[[-2, 0], [2, 0]])}, obstacles={"wall": wall})
    turn(ready)
    assert len(present(group_of(ready).awareness.tracks)) == 2


# --- in every world ---------------------------------------------------------------------------------------------------


def world(use: str) -> ColumnEnvironment:
    from symaware_cli.engine.environments.kinematic import KinematicEnvironment
    from symaware_cli.worlds.planar import PymunkEnvironment
    from symaware_cli.worlds.spatial import PyBulletEnvironment

    worlds: dict[str, Any] = {
        "kinematic": KinematicEnvironment,
        "pymunk": PymunkEnvironment,
        "pybullet": PyBulletEnvironment,
    }
    environment: ColumnEnvironment = worlds[use](worlds[use].Parameters(time_step=STEP / 1e9))
    return environment


every_world = pytest.mark.parametrize("use", ["kinematic", "pymunk", "pybullet"])

BODY = Entity(shape={"cylinder": {"radius": 0.2, "height": 1.0}}, mass=1.0)


@every_world
def test_a_body_between_two_agents_hides_them_from_each_other_in_every_world(use: str) -> None:
    things = {
        "disc": {"shape": {"cylinder": {"radius": 0.5, "height": 2.0}}, "position": [0, 0]},
        "box": {"shape": {"box": {"length": 1, "width": 1, "height": 2}}, "position": [0, 4], "heading": math.pi / 4},
        "wall": {"shape": {"wall": {"points": [[-1, 8], [1, 8]]}}},
    }
    obstacles = {name: Obstacle.model_validate(each) for name, each in things.items()}
    # Pairs to either side: through the thing, just within its edge, and just past it.
    edges = {0.0: 0.5, 4.0: math.sqrt(0.5)}
    pairs = [((-2.0, y + off), (2.0, y + off)) for y, edge in edges.items() for off in (0.0, edge - 0.01, edge + 0.01)]
    pairs += [((x, 7.0), (x, 9.0)) for x in (0.0, 0.99, 1.2)]
    team = Team(sense(range=20.0, occlusion=True), 2 * len(pairs), [*map(list, sum(pairs, ()))], entity=Entity())
    ready = begun({"robot": team}, environment=world(use), obstacles=obstacles)
    with ready.environment:
        turn(ready)
        seen = seen_by(group_of(ready))
    visible = [(2 * number, 2 * number + 1) in seen for number in range(len(pairs))]
    assert visible == [False, False, True] * 3


@pytest.mark.parametrize(
    ("thing", "hides"),
    [
        ({"shape": {"box": {"length": 1, "width": 1, "height": 1}}, "position": [0, 0, 0.5]}, True),
        ({"shape": {"box": {"length": 1, "width": 1, "height": 1}}, "position": [0, 0, 4.0]}, False),
        ({"shape": {"box": {"length": 1, "width": 1, "height": 0.05}}, "position": [0, 0, 0.025]}, False),
        # What a mesh is like counts, not the disc that others take it for.
        ({"shape": {"mesh": {"file": "cube.obj", "radius": 0.1}}, "position": [0, 0.3, 0.0]}, True),
        ({"shape": {"mesh": {"file": "cube.obj", "radius": 2.0}}, "position": [0, 0.7, 0.0]}, False),
    ],
)
def test_in_space_things_hide_by_their_very_shape(thing: dict[str, Any], hides: bool, tmp_path: Path) -> None:
    corners = [f"v {x} {y} {z}" for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
    faces = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    (tmp_path / "cube.obj").write_text("\n".join(corners + [f"f {each}" for each in faces]))
    team = Team(sense(range=9.0, occlusion=True), 2, [[-2, 0], [2, 0]], entity=BODY)
    environment = world("pybullet")
    environment.folder = tmp_path
    ready = begun({"robot": team}, environment=environment, obstacles={"thing": Obstacle.model_validate(thing)})
    with ready.environment:
        turn(ready)
        assert (not seen_by(group_of(ready))) is hides


@every_world
def test_a_moved_body_hides_agents_at_its_new_place(use: str) -> None:
    """In the physics worlds the bulldozer pushes the crate out of the way; elsewhere it goes by itself."""
    crate: dict[str, Any] = {"shape": {"box": {"length": 0.5, "width": 0.5, "height": 1.0}}}
    if use == "kinematic":
        crate |= {"path": {"times": [0, 2], "positions": [[0, 0], [0, 2]]}}
    else:
        crate |= {"position": [0, 0], "mass": 1.0}
    watchers = Team(sense(range=9.0, occlusion=True), 2, [[-2, 0], [2, 0]], entity=BODY)
    bulldozer = Team(count=1, state=[[0, -0.6]], entity=BODY)
    obstacles = {"crate": Obstacle.model_validate(crate)}
    ready = begun({"robot": watchers, "bulldozer": bulldozer}, environment=world(use), obstacles=obstacles)
    with ready.environment:
        turn(ready)
        assert (0, 1) not in pairs_of(ready)
        for _ in range(40):
            group_of(ready, "bulldozer").control_input = [[0.0, 1.0]]
            step(ready)
        turn(ready)
        assert (0, 1) in pairs_of(ready)


def pairs_of(ready: Simulation) -> set[tuple[int, int]]:
    """Which watchers see each other."""
    ids = ready.environment.roster.ids
    return {(row, int(ids[other][-1])) for row, other in seen_by(group_of(ready)) if ids[other].startswith("robot")}


# --- what does not go together ----------------------------------------------------------------------------------------


def test_a_field_of_view_needs_a_heading() -> None:
    group = Team().group("robot")
    with pytest.raises(ValueError, match="`field_of_view` needs a model with a heading"):
        RangePerception(RangePerception.Parameters(range=1.0, field_of_view=1.0)).check(group)
    RangePerception(RangePerception.Parameters(range=1.0, field_of_view=2 * math.pi)).check(group)
    RangePerception(RangePerception.Parameters(range=1.0, field_of_view=1.0)).check(
        Team(model=Unicycle()).group("robot")
    )


def test_a_list_of_deviations_fits_the_state() -> None:
    with pytest.raises(ValueError, match="`self_noise` is a list of 3, and the state has 2 elements: x, y"):
        RangePerception(RangePerception.Parameters(range=1.0, self_noise=[1, 2, 3])).check(Team().group("robot"))


# --- in space ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("height", "delay", "seen"),
    [(0.5, 0.0, False), (2.0, 0.0, True), (2.0, STEP / 1e9, True), (0.5, STEP / 1e9, False)],
)
def test_in_space_one_sees_over_a_wall_and_not_through_it(height: float, delay: float, seen: bool) -> None:
    from symaware_cli.worlds.spatial import PyBulletEnvironment

    model = SingleIntegrator(SingleIntegrator.Parameters(dimensions=3))
    states = [[-2.0, 0.0, height], [2.0, 0.0, height]]
    teams = {"robot": Team(sense(range=10.0, occlusion=True, delay=delay), 2, states, model=model)}
    walls = {"wall": Obstacle.model_validate({"shape": {"wall": {"points": [[0, -3], [0, 3]]}}})}
    world = PyBulletEnvironment(PyBulletEnvironment.Parameters(time_step=STEP / 1e9))
    ready = begun(teams, environment=world, obstacles=walls)
    with world:
        turn(ready)
        step(ready)
        turn(ready)
        assert bool(seen_by(group_of(ready))) == seen


def test_a_line_that_dips_behind_a_wall_is_cut_only_where_it_is_low() -> None:
    from symaware_cli.geometry.scenery import HeightRange, Scenery

    wall = Obstacle.model_validate({"shape": {"box": {"length": 0.2, "width": 6.0}}, "position": [0, 0]})
    scenery = Scenery({"wall": wall}, 0, {"wall": HeightRange(0.5, -0.5, 0.5)})
    ends = np.array([[-2, 0, 3], [-2, 0, 0.5], [2, 0, 0.5], [-2, 0, 2.0]], float)
    targets = np.array([[2, 0, 0.5], [2, 0, 0.5], [-2, 0, 3.0], [2, 0, -0.5]], float)
    # Over it; through it; the first the other way; and down through it.
    assert scenery.blocks(ends, targets).tolist() == [False, True, False, True]
    assert scenery.blocks(ends[:, :2], targets[:, :2]).all()
