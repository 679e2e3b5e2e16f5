"""Who reaches whom in each topology."""

import tracemalloc
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networking import laid, pairs, world
from numpy.typing import NDArray
from scipy import stats
from simulating import STEP, Team, present, simulation, untyped

from symaware_cli import Topology
from symaware_cli.core import Links, Obstacle, Roster
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.network.network import Network, TopologyPhase
from symaware_cli.engine.network.topology.fixed import (
    Complete,
    FixedTopology,
    Graph,
    Grid,
    Line,
    Random,
    Ring,
    Star,
    Tree,
)
from symaware_cli.engine.network.topology.spatial import LineOfSight, Nearest, Range
from symaware_cli.engine.network.topology.topology import TopologyError
from symaware_cli.world.chance import agent_numbers, combined, key_of, uniform


def both(*edges: tuple[int, int]) -> list[tuple[int, int]]:
    return sorted([*edges, *((other, one) for one, other in edges)])


@pytest.mark.parametrize(
    ("topology", "parameters", "expected"),
    [
        (Complete, {}, both((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))),
        (Star, {}, both((0, 1), (0, 2), (0, 3))),
        (Star, {"hub": "robot.2"}, both((2, 0), (2, 1), (2, 3))),
        (Ring, {}, both((0, 1), (1, 2), (2, 3), (3, 0))),
        (Ring, {"directed": True}, [(0, 1), (1, 2), (2, 3), (3, 0)]),
        (Line, {}, both((0, 1), (1, 2), (2, 3))),
        (Line, {"neighbours": 2, "directed": True}, [(0, 1), (0, 2), (1, 2), (1, 3), (2, 3)]),
        (Line, {"members": ("robot.3", "robot.1")}, both((1, 3))),
        (Grid, {}, both((0, 1), (2, 3), (0, 2), (1, 3))),
        (Grid, {"columns": 3}, both((0, 1), (1, 2), (0, 3))),
        (Tree, {}, both((0, 1), (0, 2), (1, 3))),
        (Tree, {"branches": 3}, both((0, 1), (0, 2), (0, 3))),
        (Graph, {"edges": (("robot.0", "robot.[23]"),)}, both((0, 2), (0, 3))),
        (Graph, {"edges": (("robot.0", "robot.3"),), "directed": True}, [(0, 3)]),
        (Graph, {"edges": (("robot.0", "robot"),), "members": ("robot.[023]",)}, both((0, 2), (0, 3))),
        (Star, {"hub": "robot", "members": ("robot.2",)}, []),
        (Random, {"probability": 0.0}, []),
        (Random, {"probability": 1.0}, both((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))),
    ],
)
def test_a_topology_that_stays_as_it_is(
    topology: type[FixedTopology], parameters: dict[str, Any], expected: list[tuple[int, int]]
) -> None:
    made = laid(topology, world(4), **parameters)
    assert pairs(made.links(0)) == expected
    assert made.links(STEP) is made.links(0)


def test_a_torus_has_four_neighbours_each() -> None:
    assert laid(Grid, world(12), columns=4, wraps=True).links(0).degrees().tolist() == [4] * 12
    with pytest.raises(TopologyError, match="10 members do not fill 3 rows of 4"):
        laid(Grid, world(10), columns=4, wraps=True)


@pytest.mark.parametrize(
    ("topology", "parameters", "problem", "path"),
    [
        (Ring, {"members": ("robot", "rover")}, "no agent or group `rover`", ("members", 1)),
        (Star, {"hub": "rover"}, "no agent or group `rover`", ("hub",)),
        (Star, {"hub": "robot"}, "matches 4 agents", ("hub",)),
        (Graph, {"edges": (("robot.0", "robot.1"), ("robot.1", "rover"))}, "no agent", ("edges", 1, 1)),
        (Graph, {"edges": (("robot.1", "robot.1"),)}, "cannot be linked with itself", ("edges", 0)),
        (
            Graph,
            {"edges": (("robot.0", "robot.1"),), "members": ("robot.0", "robot.2")},
            "not among the `members`",
            ("edges", 0, 1),
        ),
        (Star, {"hub": "robot.0", "members": ("robot.2", "robot.1")}, "`robot.0` is not among the `members`", ("hub",)),
        (Random, {"probability": 0.0, "connected": True}, "none of 1000 drawn graphs is connected", ("probability",)),
    ],
)
def test_impossible_parameters_are_reported_at_their_place(
    topology: type[FixedTopology], parameters: dict[str, Any], problem: str, path: tuple[int | str, ...]
) -> None:
    with pytest.raises(TopologyError, match=problem) as caught:
        laid(topology, world(4), **parameters)
    assert caught.value.path == path


def test_all_edges_that_cannot_be_are_said_at_once() -> None:
    edges = (("robot.0", "robot.0"), ("rover", "robot.1"), ("robot.1", "robot.1"))
    with pytest.raises(TopologyError) as caught:
        laid(Graph, world(4), edges=edges)
    told = [caught.value, *caught.value.others]
    assert [each.path for each in told] == [("edges", 0), ("edges", 1, 0), ("edges", 2)]


def test_a_random_graph_has_as_many_links_as_its_probability_says() -> None:
    links = laid(Random, world(150), probability=0.1).links(0)
    assert stats.binomtest(len(links) // 2, 150 * 149 // 2, 0.1).pvalue > 1e-3
    assert pairs(links) == both(*[each for each in pairs(links) if each[0] < each[1]])
    directed = laid(Random, world(150), probability=0.1, directed=True).links(0)
    assert stats.binomtest(len(directed), 150 * 149, 0.1).pvalue > 1e-3


def test_a_random_link_between_two_agents_does_not_depend_on_other_agents() -> None:
    few, more = (laid(Random, world(count), probability=0.5).links(0) for count in (10, 20))
    assert pairs(few) == [each for each in pairs(more) if max(each) < 10]
    assert pairs(laid(Random, world(10), seed=8, probability=0.5).links(0)) != pairs(few)


def agent_keys(ids: Sequence[str]) -> NDArray[np.uint64]:
    """What random graphs of the seed 7 are drawn by."""
    return combined(agent_numbers(ids), np.zeros(len(ids), np.uint64), key_of(7, "topology"))


def people(count: int) -> KinematicEnvironment:
    """A world of which nothing is known but who is in it."""
    environment = KinematicEnvironment()
    environment.roster = Roster({"robot": tuple(f"robot.{number}" for number in range(count))})
    return environment


@pytest.mark.parametrize("directed", [False, True])
def test_pairs_are_drawn_in_blocks_as_if_all_at_once(directed: bool) -> None:
    count = 300
    assert count * (count - 1) // 2 > 5 * Random._BLOCK
    links = laid(Random, people(count), probability=0.02, directed=directed).links(0)
    keys = agent_keys([f"robot.{number}" for number in range(count)])
    one, other = (each.ravel() for each in np.indices((count, count)))
    drawn = uniform(keys[one], keys[other], 0, 1).reshape(count, count) < 0.02
    if not directed:
        # Of the two draws of a pair, that from the smaller key.
        drawn &= keys[:, None] <= keys[None]
        drawn |= drawn.T
    np.fill_diagonal(drawn, False)
    assert pairs(links) == [tuple(each) for each in np.argwhere(drawn).tolist()]


def test_many_pairs_are_drawn_in_little_memory() -> None:
    world_of_many = people(1500)
    tracemalloc.start()
    links = laid(Random, world_of_many, probability=0.002).links(0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert stats.binomtest(len(links) // 2, 1500 * 1499 // 2, 0.002).pvalue > 1e-3
    # Of a million pairs a single number each would be 9 MB.
    assert peak < 5e6


@pytest.mark.parametrize(
    ("count", "probability", "directed"), [(400, 0.001, False), (1000, 0.004, False), (1000, 0.0045, True)]
)
def test_that_a_random_graph_is_as_good_as_never_connected_is_known_beforehand(
    count: int, probability: float, directed: bool
) -> None:
    # P. Erdos and A. Renyi (1959): a graph of n is connected with a probability of about exp(-n exp(-n p)).
    with pytest.raises(TopologyError, match=r"hardly ever connected; they often are from about ln\(n\)/n"):
        laid(Random, people(count), probability=probability, directed=directed, connected=True)


@pytest.mark.parametrize("directed", [False, True])
def test_a_graph_is_given_up_as_soon_as_somebody_is_alone(directed: bool) -> None:
    topology = laid(Random, people(150), probability=0.03, directed=directed, connected=True)
    keys = agent_keys(topology.roster.ids)
    drawn = [topology._draw(keys, attempt) for attempt in range(12)]
    assert None in drawn
    free = Random(Random.Parameters(probability=0.03, directed=directed))
    for attempt, given_up in enumerate(each is None for each in drawn):
        one, other = present(free._draw(keys, attempt))
        ends = (one, other) if directed else (np.concatenate([one, other]),) * 2
        assert given_up == any(len(np.unique(each)) < 150 for each in ends)


def test_a_random_graph_that_is_to_be_connected_is_so() -> None:
    sparse = [laid(Random, world(12), seed, probability=0.2) for seed in range(8)]
    assert any(len(np.unique(each.links(0).parts())) > 1 for each in sparse)
    for seed in range(8):
        links = laid(Random, world(12), seed, probability=0.2, connected=True).links(0)
        assert len(np.unique(links.parts())) == 1


@given(st.integers(1, 5), st.data())
def test_a_pair_has_a_link_if_it_is_one_of_those_given_and_not_an_agent_with_itself(count: int, data: Any) -> None:
    agents = st.integers(0, count - 1)
    given = data.draw(st.lists(st.tuples(agents, agents)) | st.just(pairs_of(count)))
    links = Links.of(count, np.array([one for one, _ in given], int), np.array([other for _, other in given], int))
    assert [*zip(links.senders.tolist(), links.receivers.tolist(), strict=True)] == sorted(
        {pair for pair in given if pair[0] != pair[1]}
    )
    every = pairs_of(count)
    found = links.has(np.array([one for one, _ in every]), np.array([other for _, other in every]))
    assert found.tolist() == [pair in given and pair[0] != pair[1] for pair in every]


def pairs_of(count: int) -> list[tuple[int, int]]:
    """All pairs of agents, and each with itself."""
    return [(one, other) for one in range(count) for other in range(count)]


@pytest.mark.parametrize("ends", [(0, 7), (7, 0), (0, -1), (5, 5)])
def test_a_link_ends_at_somebody(ends: tuple[int, int]) -> None:
    one, other = (np.array([1, each]) for each in ends)
    for make in (Links, Links.of):
        with pytest.raises(ValueError, match=r"of index (7|-1|5), and there are 5 agents"):
            make(5, one, other)


@pytest.mark.parametrize(
    ("links", "problem"),
    [
        (Links.of(4, np.array([0]), np.array([1])), "those of 4 agents, and there are 3"),
        ([(0, 1)], "of the type list instead of `Links`"),
    ],
)
def test_the_links_of_a_topology_are_checked(links: Links | list[tuple[int, int]], problem: str) -> None:
    topology = laid(Complete, world(3))
    topology._links = untyped(links)
    with pytest.raises((TypeError, ValueError), match=problem):
        Network(topology.roster, [TopologyPhase(0, topology)]).update(0)


class Walk:
    """A world whose agents are put somewhere by hand."""

    def __init__(self, positions: Sequence[tuple[int, int]], **kwargs: Any) -> None:
        self.environment = world(len(positions), positions, **kwargs)

    def go(self, positions: Sequence[tuple[float, int]]) -> None:
        group = self.environment.groups[0]
        self.environment.push(group, range(len(group)), np.array(positions) - self.environment.state(group))


def near(positions: NDArray[np.float64], reach: float) -> list[tuple[int, int]]:
    apart = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    return [(one, other) for one, other in np.argwhere(apart <= reach).tolist()]


coordinates = st.lists(
    st.tuples(st.floats(-10, 10, width=16), st.floats(-10, 10, width=16)), min_size=2, max_size=40, unique=True
)


@settings(max_examples=40, deadline=None)
@given(coordinates, st.floats(0.5, 8, width=16))
def test_those_within_range_reach_each_other(positions: list[tuple[float, float]], reach: float) -> None:
    links = laid(Range, world(len(positions), positions), range=reach).links(0)
    assert pairs(links) == near(np.array(positions), reach)


def test_reached_agents_stay_reached_a_little_farther_away() -> None:
    walk = Walk([(0, 0), (5, 0)])
    topology = laid(Range, walk.environment, range=4.0, hysteresis=1.0)
    linked = []
    for x in (4.5, 3.9, 4.5, 5.0, 5.1, 4.5, 4.0):
        walk.go([(0, 0), (x, 0)])
        linked.append(len(topology.links(0)))
    assert linked == [0, 2, 2, 2, 0, 0, 2]


def test_hysteresis_begins_anew_after_another_topology_held() -> None:
    walk = Walk([(0, 0), (3, 0)])
    phases = [
        TopologyPhase(0, laid(Range, walk.environment, range=4.0, hysteresis=1.0)),
        TopologyPhase(2 * STEP, laid(Graph, walk.environment, edges=(("robot.0", "robot.1"),), directed=True)),
    ]
    network = Network(walk.environment.roster, phases, repeat=3 * STEP)
    linked = []
    for step, x in enumerate((3.0, 4.5, 9.0, 4.5, 3.9, 4.5)):
        walk.go([(0, 0), (x, 0)])
        network.update(step * STEP)
        assert network.links is not None
        linked.append(len(network.links))
    assert linked == [2, 2, 1, 0, 2, 1]


def test_links_that_stay_are_the_same_object() -> None:
    walk = Walk([(0, 0), (5, 0), (9, 0)])
    topology = laid(Range, walk.environment, range=6.0)
    before = topology.links(0)
    walk.go([(0, 0), (5.5, 0), (9, 0)])
    assert topology.links(STEP) is before
    walk.go([(0, 0), (6.5, 0), (9, 0)])
    assert topology.links(2 * STEP) is not before


@settings(max_examples=40, deadline=None)
@given(coordinates, st.integers(1, 5))
def test_each_reaches_those_nearest_to_it(positions: list[tuple[float, float]], count: int) -> None:
    links = laid(Nearest, world(len(positions), positions), count=count, directed=True).links(0)
    most = min(count, len(positions) - 1)
    assert links.degrees().tolist() == [most] * len(positions)
    places = np.array(positions)
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    for row, distances in enumerate(apart):
        reached = np.sort(distances[links.of_sender(row)])
        assert np.allclose(reached, np.sort(distances)[:most])
    mutual = laid(Nearest, world(len(positions), positions), count=count).links(0)
    assert pairs(mutual) == both(*{(min(each), max(each)) for each in pairs(links)})


def test_those_at_one_place_are_still_each_others_nearest() -> None:
    links = laid(Nearest, world(4, [(1, 1)] * 4), count=1, directed=True).links(0)
    assert links.degrees().tolist() == [1] * 4


def test_an_obstacle_in_between_cuts_a_link() -> None:
    wall = Obstacle.model_validate({"shape": {"box": {"length": 0.2, "width": 4.0}}, "position": [2.0, 0.0]})
    positions = [(0, 0), (4, 0), (0, 3), (4, 3)]
    links = laid(LineOfSight, world(4, positions, obstacles={"wall": wall}), range=4.5).links(0)
    assert pairs(links) == both((0, 2), (1, 3), (2, 3))


def test_an_agent_that_takes_no_part_reaches_nobody() -> None:
    teams = {"car": Team(count=2, state=[[0, 0], [1, 0]]), "bike": Team(count=2, state=[[0, 1], [1, 1]])}
    environment = simulation(teams).environment
    everybody = laid(Range, environment, range=2.0)
    assert len(everybody.links(0)) == 12
    # The roster sorts groups by name: bikes are 0 and 1.
    chosen: list[tuple[type[Topology], dict[str, Any]]] = [(Range, {"range": 2.0}), (Complete, {})]
    for topology, parameters in chosen:
        assert pairs(laid(topology, environment, members=("car",), **parameters).links(0)) == both((2, 3))


@given(st.integers(1, 12), st.lists(st.tuples(st.integers(0, 11), st.integers(0, 11)), max_size=40))
def test_parts_contain_agents_that_reach_each_other(count: int, edges: list[tuple[int, int]]) -> None:
    edges = [(one % count, other % count) for one, other in edges]
    links = Links.of(count, np.array([one for one, _ in edges], int), np.array([other for _, other in edges], int))
    assert pairs(links) == sorted({edge for edge in edges if edge[0] != edge[1]})
    reach = np.eye(count, dtype=bool)
    for one, other in pairs(links):
        reach[one, other] = True
    for middle in range(count):
        reach |= reach[:, [middle]] & reach[[middle], :]
    mutual = reach & reach.T
    parts = links.parts()
    assert ((parts[:, None] == parts[None]) == mutual).all()
