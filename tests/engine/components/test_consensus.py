"""Agents agree on the mean as the Laplacian says, and are told where they cannot."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import STEP, Team, present, untyped
from talking import Setting, Watch, made

from symaware_cli import Agent, Fault
from symaware_cli.engine.components.communication.consensus import Consensus
from symaware_cli.engine.faults.freeze import Freeze
from symaware_cli.engine.faults.restart import Restart
from symaware_cli.engine.network.topology.fixed import Complete, FixedTopology, Graph, Line, Random, Ring, Star, Tree
from symaware_cli.engine.runtime.timing import Timing


def consensus(
    topology: type[FixedTopology],
    gain: float | None,
    steps: int,
    count: int = 12,
    channel: Mapping[str, Any] | None = None,
    weights: str = "uniform",
    **parameters: Any,
) -> tuple[NDArray[np.float64], NDArray[np.float64], Watch]:
    """The values of all agents at each turn, and the eigenvalues of the Laplacian."""
    first = np.random.default_rng(5).uniform(0, 10, count)
    knowledge = [{"value": float(each)} for each in first]
    agree = made(Consensus, gain=gain, weights=weights)
    watch = Watch({"node": Team({"agree": agree}, count=count, knowledge=knowledge)}, topology, channel, **parameters)
    group = watch.groups["node"]
    watch.run(steps, lambda: [known["value"] for known in group.knowledge])
    assert watch.simulation.exchange.network is not None
    links = watch.simulation.exchange.network.links
    adjacency = np.zeros((count, count))
    assert links is not None
    adjacency[links.senders, links.receivers] = 1
    laplacian = np.diag(adjacency.sum(axis=1)) - adjacency
    return np.array(watch.frames[:-1] if len(watch.frames) > steps else watch.frames), laplacian, watch


GRAPHS = [
    (Ring, 0.3, {}),
    (Star, 0.08, {}),
    (Random, 0.1, {"probability": 0.4, "connected": True}),
]


class TestConsensus:
    @pytest.mark.parametrize(("topology", "gain", "parameters"), GRAPHS)
    def test_values_follow_the_laplacian_exactly(
        self, topology: type[FixedTopology], gain: float, parameters: Mapping[str, Any]
    ) -> None:
        values, laplacian, _ = consensus(topology, gain, 60, **parameters)
        expected = [values[0]]
        for _ in values[1:]:
            expected.append(expected[-1] - gain * laplacian @ expected[-1])
        assert np.allclose(values, expected, atol=1e-12)

    @pytest.mark.parametrize("loss", [0.0, 0.2])
    @pytest.mark.parametrize(("topology", "gain", "parameters"), GRAPHS)
    def test_all_come_to_the_mean_as_fast_as_the_laplacian_says(
        self, topology: type[FixedTopology], gain: float, parameters: Mapping[str, Any], loss: float
    ) -> None:
        values, laplacian, watch = consensus(topology, gain, 400, channel={"loss": loss}, **parameters)
        error = np.linalg.norm(values - values[0].mean(), axis=1)
        eigenvalues = np.linalg.eigvalsh(laplacian)
        predicted = max(1 - gain * eigenvalues[1], gain * eigenvalues[-1] - 1)
        # Until rounding takes over.
        steady = np.flatnonzero((error < 0.1 * error[0]) & (error > 1e-9))
        rate = np.exp(np.polyfit(steady, np.log(error[steady]), 1)[0])
        assert rate == pytest.approx(predicted, abs=0.01 if loss == 0.0 else 0.03)
        assert error[-1] < 1e-5
        assert len({event.source for event in watch.fired("agreed")}) == 12

    @pytest.mark.parametrize("graph", [Ring, Complete])
    def test_an_agent_with_a_new_value_takes_all_others_to_the_new_mean(self, graph: type[FixedTopology]) -> None:
        def tell(agent: Agent) -> None:
            if agent.row == 2 and agent.surroundings.clock.now == 40 * STEP:
                agent.self_knowledge["value"] = agent.self_knowledge["value"] + 10.0

        knowledge = [{"value": float(row)} for row in range(5)]
        teams = {
            "node": Team(
                {"tell": lambda: Setting(tell), "agree": made(Consensus, gain=0.15)}, count=5, knowledge=knowledge
            )
        }
        watch = Watch(teams, graph).run(400)
        assert np.allclose([known["value"] for known in watch.groups["node"].knowledge], 2.0 + 10.0 / 5, atol=1e-6)

    def test_vectors_are_agreed_on_element_by_element(self) -> None:
        knowledge = [{"value": [float(row), -2.0 * row]} for row in range(5)]
        watch = Watch({"node": Team({"agree": made(Consensus, gain=0.3)}, count=5, knowledge=knowledge)}, Ring)
        watch.run(200)
        assert np.allclose([known["value"] for known in watch.groups["node"].knowledge], [2.0, -4.0], atol=1e-9)

    def test_groups_agree_with_each_other(self) -> None:
        teams = {
            name: Team({"agree": made(Consensus, gain=0.3)}, count=3, knowledge=[{"value": value}] * 3)
            for name, value in (("cat", 1.0), ("dog", 3.0))
        }
        watch = Watch(teams, Ring).run(300)
        values = [known["value"] for group in watch.groups.values() for known in group.knowledge]
        assert np.allclose(values, 2.0, atol=1e-9)

    def test_values_keep_their_shape(self) -> None:
        knowledge = [{"value": [[float(row), 1.0], [0.0, -row]]} for row in range(5)]
        watch = Watch({"node": Team({"agree": made(Consensus, gain=0.3)}, count=5, knowledge=knowledge)}, Ring)
        watch.run(200)
        expected = [[2.0, 1.0], [0.0, -2.0]]
        assert np.allclose([known["value"] for known in watch.groups["node"].knowledge], expected, atol=1e-9)


def metropolis(laplacian: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrix of Metropolis weights; each row and each column sums to 1."""
    degrees, count = np.diag(laplacian), len(laplacian)
    matrix = np.zeros((count, count))
    for i in range(count):
        for j in range(count):
            if i != j and laplacian[i, j]:
                matrix[i, j] = 1 / (1 + max(degrees[i], degrees[j]))
        matrix[i, i] = 1 - matrix[i].sum()
    return matrix


IRREGULAR = [
    (Star, {}),
    (Line, {}),
    (Tree, {"branches": 3}),
    (Random, {"probability": 0.3, "connected": True}),
    # A clique of four, a path of five from it, and a star of four at its end.
    (
        Graph,
        {
            "edges": [
                *([f"node.{i}", f"node.{j}"] for j in range(4) for i in range(j)),
                *([f"node.{i}", f"node.{i + 1}"] for i in range(3, 8)),
                *(["node.8", f"node.{i}"] for i in range(9, 12)),
            ]
        },
    ),
]


class TestMetropolisWeights:
    @pytest.mark.parametrize("gain", [None, 0.4])
    @pytest.mark.parametrize(("topology", "parameters"), IRREGULAR)
    def test_values_follow_the_metropolis_matrix_turn_by_turn(
        self, topology: type[FixedTopology], parameters: Mapping[str, Any], gain: float | None
    ) -> None:
        values, laplacian, watch = consensus(topology, gain, 500, weights="metropolis", **parameters)
        assert len(set(np.diag(laplacian))) > 1
        matrix = metropolis(laplacian)
        assert np.allclose(matrix, matrix.T)
        gain = 1.0 if gain is None else gain
        expected = [values[0]]
        for _ in values[1:]:
            expected.append((1 - gain) * expected[-1] + gain * matrix @ expected[-1])
        assert np.allclose(values, expected, rtol=0, atol=1e-11)
        assert np.allclose(values.sum(axis=1), values[0].sum(), rtol=0, atol=1e-10)
        assert not watch.fired("unstable")

    @pytest.mark.parametrize(
        ("gain", "channel"),
        [(None, {"loss": 0.3}), (None, {"duplication": 0.3}), (0.3, {"delay": {"uniform": [0.0, 0.3]}, "loss": 0.2})],
    )
    @pytest.mark.parametrize(("topology", "parameters"), IRREGULAR)
    def test_neither_losses_nor_delays_shift_the_mean(
        self,
        topology: type[FixedTopology],
        parameters: Mapping[str, Any],
        gain: float | None,
        channel: Mapping[str, Any],
    ) -> None:
        values, _, watch = consensus(topology, gain, 1200, channel=channel, weights="metropolis", **parameters)
        # The slowest is the line, whose error shrinks by 1 - 0.3 * 0.0227 in each turn.
        assert np.allclose(values[-1], values[0].mean(), rtol=0, atol=0.01 if gain else 1e-6)
        assert values[-1].mean() == pytest.approx(values[0].mean(), abs=1e-4)
        assert not watch.fired("unstable")

    def test_a_gain_for_all_graphs_is_not_that_of_the_greatest_degree(self) -> None:
        values, _, _ = consensus(Star, None, 200, weights="metropolis")
        apart = np.abs(values[-1] - values[0].mean()).max()
        assert apart < 1e-6
        values, _, watch = consensus(Star, 1.0, 100)
        assert np.abs(values[-1]).max() > 1e6
        assert watch.fired("unstable")

    @pytest.mark.parametrize("late", [1, 3])
    @pytest.mark.parametrize("share", [0.93, 1.07])
    def test_late_messages_limit_the_gain_by_the_sum_of_the_weights(self, late: int, share: float) -> None:
        # On a ring each weight is 1/3, so that the greatest eigenvalue is 4/3.
        gain = share * 1.5 * np.sin(np.pi / (4 * late + 2))
        values, _, watch = consensus(Ring, gain, 600, channel={"delay": (late + 1) * STEP / 1e9}, weights="metropolis")
        apart = np.abs(values - values[0].mean()).max(axis=1)
        assert apart[-1] < 0.1 * apart[0] if share < 1 else apart[-1] > 10.0 * apart[0]
        warned = watch.fired("unstable")
        assert len(warned) == (share > 1)
        if warned:
            assert warned[0].data["limit"] == pytest.approx(gain / share)

    @pytest.mark.parametrize("topology", [None, Star, Line])
    def test_groups_know_the_degrees_of_their_own(self, topology: type[FixedTopology] | None) -> None:
        values = {"cat": 1.0, "dog": 3.0, "emu": 8.0, "fox": 20.0}
        watch = watched(values, None, topology, weights="metropolis")
        watch.run(200, lambda: known(watch))
        assert np.allclose(watch.frames[-1], 8.0, atol=1e-9)
        # Where everybody reaches everybody, all weights are 1/4, and one turn is enough.
        if topology is None:
            assert np.allclose(watch.frames[1], 8.0, atol=1e-9)

    @pytest.mark.parametrize("channel", [None, {"loss": 0.3}])
    def test_an_agent_that_restarts_after_agreeing_stays_with_the_mean(self, channel: Mapping[str, Any] | None) -> None:
        values = {"cat": 1.0, "dog": 3.0, "emu": 8.0, "fox": 20.0}
        watch = watched(values, None, Star, channel, weights="metropolis")
        watch.fault(Restart, "cat", "agree", 270).fault(Restart, "emu", "agree", 290)
        watch.run(500, lambda: known(watch))
        assert np.allclose(watch.frames[269:], 8.0, atol=1e-6)

    def test_uniform_weights_need_a_gain(self) -> None:
        with pytest.raises(ValueError, match="`gain` is missing"):
            Consensus.Parameters()
        assert untyped(made(Consensus, weights="metropolis")()).gain == 1.0


def watched(
    values: Mapping[str, Any],
    gain: float | None = 0.3,
    topology: type[FixedTopology] | None = Complete,
    channel: Mapping[str, Any] | None = None,
    timing: Timing | None = None,
    weights: str = "uniform",
    **parameters: Any,
) -> Watch:
    """Groups of one agent each, by name with what it knows."""
    teams = {
        name: Team(
            {"agree": made(Consensus, gain=gain, weights=weights)},
            knowledge=[{"value": value}],
            timings={} if timing is None else {"agree": timing},
        )
        for name, value in values.items()
    }
    return Watch(teams, topology, channel, **parameters)


def known(watch: Watch) -> NDArray[np.float64]:
    return np.array([each["value"] for group in watch.groups.values() for each in group.knowledge])


class TestLateMessages:
    """x(k + 1) = x(k) - e L x(k - d) converges if and only if e lambda_n < 2 sin(pi / (4 d + 2)) (Levin, May 1976)."""

    @pytest.mark.parametrize("late", [0, 1, 3])
    @pytest.mark.parametrize("share", [0.93, 1.07])
    def test_the_limit_of_the_gain_is_that_of_the_theory(self, late: int, share: float) -> None:
        # The Laplacian of a ring of 12 has the greatest eigenvalue 4.
        gain = share * np.sin(np.pi / (4 * late + 2)) / 2
        values, laplacian, watch = consensus(Ring, gain, 600, channel={"delay": (late + 1) * STEP / 1e9})
        assert np.linalg.eigvalsh(laplacian)[-1] == pytest.approx(4.0)
        apart = np.abs(values - values[0].mean()).max(axis=1)
        assert apart[-1] < 0.1 * apart[0] if share < 1 else apart[-1] > 10.0 * apart[0]
        warned = watch.fired("unstable")
        assert len(warned) == (share > 1)
        if warned:
            assert warned[0].level.name == "WARNING"
            assert warned[0].data["limit"] == pytest.approx(gain / share)

    def test_the_mean_is_kept_all_the_same(self) -> None:
        values, _, watch = consensus(Ring, 0.05, 800, channel={"delay": {"uniform": [0.0, 0.3]}, "loss": 0.1})
        assert np.allclose(values[-1], values[0].mean(), atol=1e-4)
        assert not watch.fired("unstable")


class TestBeginningAnew:
    @pytest.mark.parametrize("channel", [None, {"loss": 0.3}, {"delay": 0.12, "loss": 0.1}])
    def test_an_agent_that_has_agreed_stays_with_the_mean(self, channel: Mapping[str, Any] | None) -> None:
        watch = watched({"cat": 1.0, "dog": 3.0, "emu": 8.0}, 0.14, channel=channel)
        watch.fault(Restart, "cat", "agree", 70).fault(Restart, "emu", "agree", 90).fault(Restart, "cat", "agree", 100)
        watch.run(400, lambda: known(watch))
        assert np.allclose(watch.frames[69], 4.0, atol=1e-2)
        assert np.allclose(watch.frames[70:], watch.frames[69].mean(), atol=1e-2)

    @pytest.mark.parametrize("kind", [Restart, Freeze])
    def test_agents_on_the_way_agree_on_a_value_between(self, kind: type[Fault]) -> None:
        watch = watched({"cat": 1.0, "dog": 3.0, "emu": 8.0}, 0.14)
        watch.fault(kind, "dog", "agree", 8, None if kind is Restart else 40).run(400, lambda: known(watch))
        frames = np.array(watch.frames)
        assert ((frames >= 1.0 - 1e-9) & (frames <= 8.0 + 1e-9)).all()
        assert np.ptp(frames[-1]) < 1e-6
        # What two turns would have brought is lost at most, or what others did meanwhile made up for otherwise.
        assert frames[-1].mean() == pytest.approx(4.0, abs=0.3)


#: Values that exceed the range of numbers after a few turns, if each turn doubles their differences.
HUGE = {"cat": 1e306, "dog": 3e306, "emu": 8e306}


class TestNoEnd:
    def test_a_value_that_is_not_finite_is_a_failure(self) -> None:
        watch = watched(HUGE, 1.0)
        watch.run(30, status="failed")
        assert "the consensus on `value` diverges" in present(watch.summary.failure)
        assert watch.fired("unstable")[0].time == STEP

    def test_on_failure_decides_what_happens_to_the_agent(self) -> None:
        watch = watched(HUGE, 1.0, timing=Timing(on_failure="isolate"))
        watch.run(30)
        assert {event.source for event in watch.fired("terminated")} >= {"agents.cat"}
        assert np.isfinite(known(watch)).all()
