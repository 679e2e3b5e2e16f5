"""What an agent makes of what it is told, beside what it sees."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from faulting import fault
from numpy.typing import NDArray
from pydantic import ValidationError
from simulating import STEP, Team, present, simulation, untyped
from talking import Setting

from symaware_cli import (
    Agent,
    AgentSelection,
    Component,
    ComponentSelection,
    Delivery,
    Fault,
    GroupComponent,
    Links,
    TimeSeries,
    Topology,
)
from symaware_cli.core import GroupAwareness
from symaware_cli.engine.components.communication.inbox import Inbox
from symaware_cli.engine.components.communication.state import Broadcast, StateSender
from symaware_cli.engine.components.perception import OmniscientPerception, SelfPerception
from symaware_cli.engine.components.perception_range import RangePerception
from symaware_cli.engine.components.uncertainty_gaussian import GaussianUncertainty
from symaware_cli.engine.faults.cut import Cut
from symaware_cli.engine.faults.restart import Restart
from symaware_cli.engine.faults.stop import Stop
from symaware_cli.engine.network.channel.channel_parameters import ChannelParameters
from symaware_cli.engine.network.network import Network, TopologyPhase
from symaware_cli.engine.network.topology.fixed import Complete
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.run import run
from symaware_cli.engine.runtime.timing import Timing

A, B = frozenset({"a"}), frozenset({"b"})


class Late(Topology):
    """Nobody reaches anybody for a second, then everybody all."""

    changes = True

    def links(self, now: int) -> Links:
        count = len(self.roster)
        everybody = np.arange(count)
        nobody = np.empty(0, np.intp)
        if now < 20 * STEP:
            self._links = Links.of(count, nobody, nobody)
        elif not len(self._links):
            self._links = Links.of(count, np.repeat(everybody, count), np.tile(everybody, count))
        return self._links


def made(kind: type[Component | GroupComponent], **parameters: Any) -> Callable[..., Any]:
    return lambda: kind(kind.Parameters(**parameters))


def moving(speed: float = 2.0) -> Callable[..., Any]:
    def move(agent: Agent) -> None:
        agent.model.control_input = [speed, 0.0]

    return lambda: Setting(move)


def speaker(tell: Callable[..., Any] = StateSender, speed: float = 2.0, **options: Any) -> Team:
    """One who knows where it is, moves and tells of it."""
    return Team({"move": moving(speed), "sense": SelfPerception, "tell": tell}, **options)


class Scene:
    """A run, looked at after the turns of each step."""

    def __init__(
        self, topology: type[Topology] | None = None, channel: Mapping[str, Any] | None = None, **teams: Team
    ) -> None:
        self.simulation = simulation(teams)
        self.groups = {group.name: group for group in self.simulation.groups}
        self.entries = {f"{entry.group.name}.{entry.name}": entry for entry in self.simulation.entries}
        if topology is not None:
            links = topology(topology.Parameters())
            links.initialise(self.simulation.environment, 7)
            roster, paths = self.simulation.environment.roster, ChannelParameters.model_validate(channel or {})
            self.simulation.connect(Network(roster, [TopologyPhase(0, links)], channel=paths))

    def awareness(self, name: str = "b") -> GroupAwareness:
        return self.groups[name].awareness

    def position(self, id: str) -> NDArray[np.float64]:
        environment = self.simulation.environment
        result: NDArray[np.float64] = environment.snapshot().positions[environment.roster.index(id)]
        return result

    def run(self, steps: int, look: Callable[..., Any] | None = None, **faults: Fault) -> list[Any]:
        """Make the run, with faults."""
        frames = []
        if look is not None:
            self.simulation.events.subscribe("iterated", lambda event: frames.append(look()))
        for name, each in faults.items():
            each.name = name
        summary = run(self.simulation, steps, options=RunOptions(faults=[*faults.values()]))
        assert summary.status == "finished", summary.failure
        return frames

    def restart(self, entry: str, at: int) -> Fault:
        return fault(Restart, at=at, components=[ComponentSelection(self.entries[entry], [0])])

    def stop(self, group: str, at: int, lasting: int | None = None) -> Fault:
        return fault(Stop, at=at, lasting=lasting, agents=[AgentSelection(self.groups[group], [0])])


def silence(at: int, lasting: int | None = None) -> Fault:
    """The first agent does not reach the second one."""
    return fault(Cut, {"between": ["a", "b"]}, at, lasting, ways=[(A, B)])


def others(awareness: GroupAwareness) -> list[int]:
    return [] if awareness.tracks is None else awareness.tracks.others.tolist()


class TestSeeing:
    def test_one_message_does_not_hide_silent_agents_that_are_seen(self) -> None:
        scene = Scene(
            a=speaker(),
            b=Team({"see": OmniscientPerception, "hear": Inbox}, count=2, state=[[5, 0], [6, 0]]),
        )
        scene.run(5)
        near = scene.groups["b"].others(100.0)
        assert list(zip(near.observers.tolist(), near.others.tolist(), strict=True)) == [(0, 0), (0, 2), (1, 0), (1, 1)]
        # Who sees everything now has nothing to learn from a message.
        assert np.allclose(near.positions[0], scene.position("a") - [2.0 * STEP / 1e9, 0.0])
        assert scene.awareness().tracks is None

    def test_a_message_counts_where_it_is_more_recent_than_the_view_of_the_world(self) -> None:
        see = {"see": Timing(period=100 * STEP)}
        silent = Team({"move": moving(1.0)}, state=[[0, 5]])
        scene = Scene(
            a=speaker(speed=3.0),
            b=Team({"see": OmniscientPerception, "hear": Inbox}, timings=see),
            c=silent,
        )

        def turn(agent: Agent) -> None:
            agent.model.control_input = [3.0, 0.0] if agent.surroundings.clock.now < 10 * STEP else [0.0, 3.0]

        untyped(scene.entries["a.move"].components[0])._act = turn
        scene.run(30)
        near = scene.groups["b"].others(100.0)
        assert near.others.tolist() == [0, 2]
        truth = scene.position("a") - [0.0, 3.0 * STEP / 1e9]
        assert np.allclose(near.positions[0], truth)
        # Of c nobody says anything.
        assert near.ages == pytest.approx([STEP / 1e9, 29 * STEP / 1e9])

    def test_a_message_wins_over_a_sighting_that_is_older(self) -> None:
        b = Team({"see": made(RangePerception, range=100.0), "hear": Inbox}, timings={"see": Timing(period=40 * STEP)})
        scene = Scene(a=speaker(), b=b)

        def look() -> tuple[float, float]:
            tracks = scene.awareness().tracks
            assert tracks is not None
            return tracks.ages[0], np.abs(tracks.positions[0] - scene.position("a")).max()

        frames = np.array(scene.run(100, look))
        # A sighting every 2 s, a message every step; the velocity that is told is that of the step before.
        assert frames[:, 0].max() <= 1.01 * STEP / 1e9
        assert frames[3:, 1].max() < 1e-9

    def test_a_sighting_grows_old(self) -> None:
        see = {"see": Timing(period=40 * STEP)}
        b = Team({"see": made(RangePerception, range=100.0), "hear": Inbox}, timings=see)
        scene = Scene(a=Team({"move": moving()}), b=b, c=speaker())
        ages = [frame[0] for frame in scene.run(40, lambda: present(scene.awareness().tracks).ages)]
        assert ages == pytest.approx(np.arange(41)[: len(ages)] % 40 * STEP / 1e9)

    def test_received_information_stays_on_either_side_of_the_filter(self) -> None:
        first = {"sense": SelfPerception, "hear": Inbox, "filter": GaussianUncertainty}
        last = {"sense": SelfPerception, "filter": GaussianUncertainty, "hear": Inbox}
        scene = Scene(a=speaker(), b=Team(first), c=Team(last))
        scene.run(5)
        for name in ("b", "c"):
            assert others(scene.awareness(name)) == [0]


class TestForgetting:
    def test_hearsay_is_no_sighting_after_a_restart(self) -> None:
        scene = Scene(a=speaker(), b=Team({"sense": SelfPerception, "hear": made(Inbox, memory=0.5)}))
        frames = scene.run(
            40,
            lambda: others(scene.awareness()),
            hush=silence(10),
            again=scene.restart("b.hear", 12),
        )
        assert frames[9] == [0]
        assert frames[13:] == [[]] * len(frames[13:])

    def test_a_restart_does_not_stop_later_turns(self) -> None:
        channel = {"delay": 5 * STEP / 1e9}
        scene = Scene(Complete, channel, a=speaker(), b=Team({"sense": SelfPerception, "hear": Inbox}))

        def look() -> float | None:
            tracks = scene.awareness().tracks
            return None if tracks is None or not len(tracks) else tracks.ages[0]

        frames = scene.run(60, look, again=scene.restart("b.hear", 20))
        assert frames[-1] == pytest.approx(5 * STEP / 1e9)

    def test_an_agent_that_moves_straight_and_seldom_sends_is_not_forgotten(self) -> None:
        scene = Scene(a=speaker(made(StateSender, threshold=0.5)), b=Team({"hear": Inbox}))
        frames = scene.run(240, lambda: others(scene.awareness()))
        assert frames[2:] == [[0]] * len(frames[2:])

    def test_a_message_that_was_lost_is_made_good(self) -> None:
        scene = Scene(a=speaker(made(StateSender, threshold=0.5), speed=0.0), b=Team({"hear": Inbox}))
        frames = scene.run(60, lambda: others(scene.awareness()), hush=silence(0, 10))
        assert frames[20] == []
        assert frames[45] == [0]

    def test_an_agent_speaks_up_when_it_has_come_to_reach_somebody(self) -> None:
        tell = made(StateSender, threshold=100.0, silence=None)
        scene = Scene(Late, a=speaker(tell, speed=0.0), b=Team({"hear": Inbox}))
        sent = []
        scene.simulation.events.subscribe("sent", lambda event: sent.append(event.time // STEP))
        frames = scene.run(40, lambda: others(scene.awareness()))
        assert sent == [21]
        assert frames[21:23] == [[], [0]]

    def test_with_a_window_the_latest_message_counts_as_long_as_its_sender_is_remembered(self) -> None:
        hear = made(Inbox, policy="window", window=0.1, memory=1.0)
        scene = Scene(a=speaker(), b=Team({"hear": hear}))
        frames = scene.run(40, lambda: others(scene.awareness()), hush=silence(10))
        # Last told at 9 steps, remembered for 20.
        assert frames[29:31] == [[0], []]


class TestBroadcasts:
    def test_a_broadcast_makes_tracks_as_a_state_does(self) -> None:
        scene = Scene(a=speaker(Broadcast), b=Team({"hear": made(Inbox, position_noise=0.1)}), c=speaker())
        scene.run(6)
        tracks = scene.awareness().tracks
        assert tracks is not None
        assert tracks.others.tolist() == [0, 2]
        assert np.allclose(tracks.positions[0], scene.position("a") - [2.0 * STEP / 1e9, 0.0])
        for column in (tracks.positions, tracks.velocities, tracks.covariances, tracks.ages):
            assert column is not None
            assert np.array_equal(column[0], column[1])

    def test_a_message_has_the_covariance_of_its_sender(self) -> None:
        components = {"sense": SelfPerception, "filter": made(GaussianUncertainty, initial_deviation=2.0)}
        scene = Scene(
            a=Team({"filter": components["filter"], "tell": Broadcast}),
            b=Team({"hear": made(Inbox, acceleration_noise=0.0)}),
            c=Team({"filter": components["filter"], "tell": made(StateSender, uncertainty=True)}),
        )
        scene.run(4)
        assert present(present(scene.awareness().tracks).covariances)[:, 0, 0] == pytest.approx([4.0, 4.0])

    def test_intent_and_risk_are_known_of_the_sender_as_long_as_it_is_remembered(self) -> None:
        def mean(agent: Agent) -> None:
            agent.self_awareness.intent = TimeSeries({1.0: [7.0, 0.0]})
            agent.self_awareness.risk = TimeSeries({0.0: [0.3]})
            agent.model.control_input = [1.0, 0.0]

        a = Team({"sense": SelfPerception, "mean": lambda: Setting(mean), "tell": Broadcast})
        scene = Scene(a=a, b=Team({"hear": made(Inbox, memory=0.5)}))
        database = scene.groups["b"].agents[0].awareness_database

        def look() -> tuple[float, list[float], list[float], NDArray[np.float64]] | None:
            if "a" not in database:
                return None
            vector = database["a"]
            return vector.state[0], vector.intent[1.0].tolist(), vector.risk[0.0].tolist(), vector.uncertainty.values[0]

        frames = scene.run(30, look, hush=silence(10))
        # It is where it is believed to be now, as uncertain as that is; what it intends and fears is what it said.
        assert [frame[0] for frame in frames[3:20]] == pytest.approx([step * STEP / 1e9 for step in range(3, 20)])
        assert all(frame[1:3] == ([7.0, 0.0], [0.3]) for frame in frames[1:20])
        assert frames[19][3][0] > frames[11][3][0] > 0.0
        assert frames[20:] == [None] * len(frames[20:])
        assert not database.received

    def test_the_content_of_a_broadcast_can_be_looked_up(self) -> None:
        scene = Scene(a=speaker(Broadcast), b=Team({"hear": Inbox}))
        scene.run(4)
        told = scene.groups["b"].agents[0].awareness_database.received["a"]
        assert told.state.tolist() == pytest.approx([2 * 2.0 * STEP / 1e9, 0.0, 2.0, 0.0])
        assert told.uncertainty.times.tolist() == [2 * STEP]


class TestKnowledge:
    @pytest.mark.parametrize("tell", [StateSender, Broadcast])
    def test_the_message_that_was_sent_last_stays_regardless_of_arrivals(
        self, tell: type[Component | GroupComponent]
    ) -> None:
        def count(agent: Agent) -> None:
            agent.self_knowledge["value"] = float(agent.surroundings.clock.now // STEP)

        a = Team(
            {"sense": SelfPerception, "count": lambda: Setting(count), "tell": made(tell, knowledge=("value",))},
            knowledge=[{"value": 0.0}],
        )
        scene = Scene(Complete, {"jitter": 1.0}, a=a, b=Team({"hear": Inbox}))
        agent = scene.groups["b"].agents[0]
        values = scene.run(60, lambda: float(untyped(agent.knowledge_database).get("a", {}).get("value", -1.0)))
        assert values[-1] > 30
        assert values == sorted(values)

    @pytest.mark.parametrize("tell", [StateSender, Broadcast])
    @pytest.mark.parametrize("name", ["position", "velocity", "state", "covariance", "awareness"])
    def test_knowledge_does_not_replace_messages_about_the_body(
        self, tell: type[Component | GroupComponent], name: str
    ) -> None:
        with pytest.raises(ValidationError, match=f"as `{name}`"):
            tell.Parameters(knowledge=("goal", name))


class TestStopping:
    def test_an_agent_that_stopped_keeps_no_mail(self) -> None:
        class Reader(Inbox):
            """Reads every tenth step."""

        scene = Scene(a=speaker(Broadcast), b=Team({"hear": Reader}, timings={"hear": Timing(period=100 * STEP)}))
        inboxes = scene.simulation.exchange.inboxes
        frames = scene.run(40, lambda: len(inboxes._columns.get("agents.b.hear", ())), halt=scene.stop("b", 10))
        assert frames[9] > 5
        assert frames[10:] == [0] * len(frames[10:])

    def test_an_agent_that_begins_anew_begins_with_an_empty_inbox(self) -> None:
        read: list[tuple[int, int]] = []

        class Listening(Inbox):
            def _update(self, value: Sequence[Delivery]) -> None:
                read.extend((self.now // STEP, each.sent_time // STEP) for each in value)
                super()._update(value)

        scene = Scene(a=speaker(Broadcast), b=Team({"hear": Listening}))
        scene.run(30, None, halt=scene.stop("b", 10, 10))
        assert all(now - sent == 1 for now, sent in read)
        assert {now for now, _ in read} >= set(range(1, 10)) | set(range(21, 30))
