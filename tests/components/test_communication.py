"""What agents tell each other, and what they make of it."""

import numpy as np
import pytest
from simulating import STEP, Team, simulation

from symaware_cli import Component, TimeSeries
from symaware_cli.components.communication.broadcast import Broadcast
from symaware_cli.components.communication.consensus import Consensus
from symaware_cli.components.communication.flooding import Flooding
from symaware_cli.components.communication.gossip import Gossip
from symaware_cli.components.communication.inbox import Inbox
from symaware_cli.components.communication.request import Request
from symaware_cli.components.communication.state import StateSender
from symaware_cli.components.perception import SelfPerception
from symaware_cli.components.perception_range import RangePerception
from symaware_cli.network.channel.parameters import ChannelParameters
from symaware_cli.network.network import Network, Stretch
from symaware_cli.network.topology.still import Complete, Line, Random, Ring, Star
from symaware_cli.runtime.run import run


class Setting(Component):
    """Does what a test says."""

    def __init__(self, act):
        super().__init__()
        self._act = act

    def _compute(self):
        return None

    def _update(self, value):
        self._act(self._agent)


class Watch:
    """A run, and what was fired in it."""

    def __init__(self, teams, topology=None, channel=None, seed=7, **parameters):
        self.simulation = simulation(teams, seed=seed)
        self.groups = {group.name: group for group in self.simulation.groups}
        self.events = []
        self.frames = []
        if topology is not None:
            made = topology(topology.Parameters(**parameters))
            made.initialise(self.simulation.environment, seed)
            roster = self.simulation.environment.roster
            channel = ChannelParameters.model_validate(channel or {})
            self.simulation.connect(Network(roster, [Stretch(0, made)], channel=channel))
        self.simulation.events.subscribe("*", self.events.append)

    def run(self, steps, look=None):
        """Make the run; look at it after the turns of each step."""
        if look is not None:
            self.simulation.events.subscribe("iterated", lambda event: self.frames.append(look()))
        summary = run(self.simulation, steps)
        assert summary.status == "finished", summary.failure
        return self

    def fired(self, name):
        return [event for event in self.events if event.name == name]


def made(kind, **parameters):
    return lambda: kind(kind.Parameters(**parameters))


def team(count=2, control=None, knowledge=(), **components):
    def act(agent):
        if control is not None:
            agent.model.control_input = control(agent)

    each = {"sense": SelfPerception, **components, "act": lambda: Setting(act)}
    return Team(each, count=count, knowledge=knowledge)


class TestStates:
    def test_what_one_is_told_of_another_is_where_it_was_and_went(self):
        # Robots stand 1 m apart and move at 2 m/s; what is told arrives with the next step.
        watch = Watch({"robot": team(control=lambda agent: [2.0, 0.0], tell=StateSender, hear=Inbox)})
        awareness = watch.groups["robot"].awareness
        watch.run(5, lambda: (watch.simulation.environment.snapshot().positions, awareness.tracks))
        truth, tracks = watch.frames[4]
        assert tracks.others.tolist() == [1, 0]
        # The velocity that was told is that of the step before, as everybody goes straight on it is still right.
        assert np.allclose(tracks.positions, truth[[1, 0]])
        assert np.allclose(tracks.velocities, [[2.0, 0.0]] * 2)
        assert np.allclose(tracks.ages, STEP / 1e9)
        assert watch.frames[0][1] is None

    def test_uncertainty_grows_with_the_age_of_a_message(self):
        quiet = {"threshold": 100.0}
        noise = {"position_noise": 0.1, "velocity_noise": 0.2, "acceleration_noise": 0.5, "memory": 100.0}
        watch = Watch({"robot": team(tell=made(StateSender, **quiet), hear=made(Inbox, **noise))})
        awareness = watch.groups["robot"].awareness
        watch.run(60, lambda: awareness.tracks)
        age = 40 * STEP / 1e9
        tracks = watch.frames[40]
        assert np.allclose(tracks.ages, age)
        spread = 0.1**2 + 0.2**2 * age**2 + 0.5**2 * age**3 / 3
        between = 0.2**2 * age + 0.5**2 * age**2 / 2
        moving = 0.2**2 + 0.5**2 * age
        expected = np.kron([[spread, between], [between, moving]], np.eye(2))
        assert np.allclose(tracks.covariances, expected)

    def test_who_says_nothing_more_is_forgotten(self):
        watch = Watch(
            {"robot": team(tell=made(StateSender, threshold=100.0), hear=made(Inbox, memory=0.5))},
        )
        awareness = watch.groups["robot"].awareness
        watch.run(15, lambda: 0 if awareness.tracks is None else len(awareness.tracks))
        # Told at 0 s, heard at 0.05 s, remembered up to 0.5 s.
        assert watch.frames[:13] == [0, *[2] * 10, 0, 0]

    def test_an_agent_speaks_up_when_others_would_be_wrong(self):
        # One goes straight on, one turns after 10 steps.
        def control(agent):
            turned = agent.row == 1 and agent.surroundings.clock.now >= 10 * STEP
            return [0.0, 1.0] if turned else [1.0, 0.0]

        watch = Watch({"robot": team(control=control, tell=made(StateSender, threshold=0.2), hear=Inbox)})
        sent = []
        watch.simulation.events.subscribe("sent", lambda event: sent.append((event.time // STEP, event.subject.sender)))
        watch.run(30)
        # At the first turn nobody moves yet; a step of 0.05 m is noticed after 4 of them, and then they go straight on.
        assert sent[:2] == [(0, "robot.0"), (0, "robot.1")]
        later = [each for each in sent if each[0] > 6]
        assert [sender for _, sender in later] == ["robot.1"]
        assert 12 <= later[0][0] <= 15

    def test_knowledge_that_is_told_along_is_known_of_the_other(self):
        knowledge = [{"goal": [1.0, 2.0]}, {"goal": [3.0, 4.0]}]
        watch = Watch(
            {"robot": team(knowledge=knowledge, tell=made(StateSender, knowledge=("goal",)), hear=Inbox)}
        ).run(3)
        agent = watch.groups["robot"].agents[0]
        assert agent.knowledge_database["robot.1"]["goal"].tolist() == [3.0, 4.0]

    def test_what_is_seen_wins_over_what_was_told_before(self):
        see = made(RangePerception, range=1.5)
        watch = Watch({"robot": Team({"sense": see, "tell": StateSender, "hear": Inbox}, count=3)}).run(4)
        tracks = watch.groups["robot"].awareness.tracks
        # 0 and 2 are 2 m apart: they are told of each other.
        assert [tuple(each) for each in zip(tracks.observers.tolist(), tracks.others.tolist(), strict=True)] == [
            *((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
        ]
        assert tracks.ages.tolist() == [0.0, 0.05, 0.0, 0.0, 0.05, 0.0]

    def test_of_late_messages_the_one_that_was_sent_last_counts(self):
        watch = Watch(
            {"robot": team(control=lambda agent: [1.0, 0.0], tell=StateSender, hear=Inbox)},
            Complete,
            {"delay": {"uniform": [0.0, 1.0]}},
        )
        inbox = watch.simulation.slots[2].components[0]
        watch.run(80, lambda: inbox.kept.sent.tolist())
        sent = np.array([frame for frame in watch.frames if len(frame) == 2])
        assert (np.diff(sent, axis=0) >= 0).all()

    @pytest.mark.parametrize(("policy", "most"), [("latest", 1), ("window", 5), ("all", 40)])
    def test_the_inbox_keeps_what_its_policy_says(self, policy, most):
        tell = made(StateSender)
        hear = made(Inbox, policy=policy, window=0.25, position_noise=0.1, memory=100.0)
        watch = Watch({"robot": team(tell=tell, hear=hear)}).run(40)
        inbox = watch.simulation.slots[2].components[0]
        assert len(inbox.kept.keys) == 2 * (most - (policy == "all"))

    def test_messages_that_are_kept_are_averaged_by_their_certainty(self):
        class Blurred(SelfPerception):
            def _update(self, value):
                super()._update(value)
                self._group.awareness.state = self._group.awareness.state + self.random.standard_normal(2)

        def error(policy):
            hear = made(
                Inbox, policy=policy, window=1.0, position_noise=1.0, velocity_noise=0.0, acceleration_noise=0.0
            )
            watch = Watch({"robot": Team({"sense": Blurred, "tell": StateSender, "hear": hear}, count=20)}).run(25)
            tracks = watch.groups["robot"].awareness.tracks
            return (tracks.positions - watch.simulation.environment.snapshot().positions[tracks.others]).std()

        # The mean of 20 messages is sqrt(20) times as exact as the latest.
        assert error("latest") == pytest.approx(1.0, rel=0.2)
        assert error("window") == pytest.approx(1.0 / np.sqrt(20), rel=0.3)

    def test_what_cannot_be_told_is_found_before_the_run(self):
        group = team(knowledge=[{"name": "a"}, {"name": "b"}]).group("robot")
        for parameters, problem in (
            ({"knowledge": ("goal",)}, "do not know `goal`"),
            ({"knowledge": ("name",)}, "must be numbers"),
            ({"silence": 1.0}, "there is none"),
        ):
            with pytest.raises(ValueError, match=problem):
                StateSender(StateSender.Parameters(**parameters)).check(group)


class TestBroadcasts:
    def test_awareness_and_knowledge_of_any_kind_reach_all(self):
        def mean(agent):
            agent.self_awareness.intent = TimeSeries({1.0: [agent.row, 0.0]})
            return [0.0, 0.0]

        knowledge = [{"name": "anna"}, {"name": "bert"}, {"name": "carl"}]
        tell = made(Broadcast, knowledge=("name",))
        watch = Watch({"robot": team(3, mean, knowledge, tell=tell, hear=Inbox)}).run(4)
        agent = watch.groups["robot"].agents[0]
        assert agent.knowledge_database["robot.2"]["name"] == "carl"
        vector = agent.awareness_database["robot.2"]
        assert vector.state.tolist() == [2.0, 0.0]
        assert vector.intent[1.0].tolist() == [2.0, 0.0]
        # At the instant for which it was told.
        assert vector.uncertainty.times.tolist() == [3 * STEP - STEP]


class TestRequests:
    def teams(self, **ask):
        asking = made(Request, whom=("robot.*",), names=("goal",), **ask)
        return {
            "boss": Team({"ask": asking}, count=1),
            "robot": Team({"answer": Request}, count=2, knowledge=[{"goal": 1}, {"goal": "north", "secret": 2}]),
        }

    def test_who_is_asked_answers_what_it_knows(self):
        watch = Watch(self.teams()).run(10)
        known = watch.groups["boss"].agents[0].knowledge_database
        assert (dict(known["robot.0"]), dict(known["robot.1"])) == ({"goal": 1}, {"goal": "north"})
        assert [(event.time, event.data["other"]) for event in watch.fired("answered")] == [
            (2 * STEP, "robot.0"),
            (2 * STEP, "robot.1"),
        ]

    def test_who_does_not_answer_is_asked_again(self):
        watch = Watch(self.teams(timeout=0.2, tries=100), Complete, {"loss": 0.6}).run(300)
        assert {event.data["other"] for event in watch.fired("answered")} == {"robot.0", "robot.1"}
        assert watch.simulation.exchange.sent > 4

    def test_at_last_it_is_given_up(self):
        watch = Watch(self.teams(timeout=0.2, tries=3), Complete, {"loss": 1.0}).run(60)
        assert [event.data["other"] for event in watch.fired("unanswered")] == ["robot.0", "robot.1"]
        assert watch.simulation.exchange.sent == 6

    def test_answers_can_be_kept_up_to_date(self):
        watch = Watch(self.teams(interval=0.5)).run(60)
        assert len(watch.fired("answered")) == 2 * 5


class TestGossip:
    def test_a_rumour_reaches_a_thousand_in_about_as_many_rounds_as_a_logarithm_says(self):
        rounds = {}
        for count in (10, 100, 1000):
            knowledge = [{"rumour": "fire"}] + [{} for _ in range(count - 1)]
            watch = Watch({"robot": Team({"tell": Gossip}, count=count, knowledge=knowledge)}, Complete)
            watch.run(40)
            informed = [event.time // STEP for event in watch.fired("informed")]
            assert len(informed) == count - 1
            rounds[count] = max(informed)
        # Pittel 1987: log2(n) + ln(n), up to a constant; it takes a step more for the first to be told.
        for count, taken in rounds.items():
            assert abs(taken - (np.log2(count) + np.log(count))) < 6, rounds

    def test_a_later_version_takes_the_place_of_an_earlier_one(self):
        def change(agent):
            if agent.row == 3 and agent.surroundings.clock.now == 20 * STEP:
                agent.self_knowledge["rumour"] = "no fire"
            return [0.0, 0.0]

        knowledge = [{"rumour": "fire"}] + [{} for _ in range(9)]
        watch = Watch({"robot": team(10, change, knowledge, tell=Gossip)}, Complete).run(60)
        assert {known["rumour"] for known in watch.groups["robot"].knowledge} == {"no fire"}

    def test_it_gets_through_where_much_is_lost(self):
        knowledge = [{"rumour": "fire"}] + [{} for _ in range(29)]
        watch = Watch({"robot": Team({"tell": Gossip}, count=30, knowledge=knowledge)}, Complete, {"loss": 0.5})
        watch.run(60)
        assert len(watch.fired("informed")) == 29


class TestFlooding:
    def flood(self, count, steps, topology=Line, channel=None, **parameters):
        knowledge = [{"alarm": "fire"}] + [{} for _ in range(count - 1)]
        flooding = made(Flooding, names=("alarm",), **parameters)
        watch = Watch({"robot": Team({"tell": flooding}, count=count, knowledge=knowledge)}, topology, channel)
        return watch.run(steps)

    def test_what_is_flooded_goes_on_from_one_to_the_next(self):
        watch = self.flood(6, 10)
        heard = {event.source: (event.time // STEP, event.data["hops"]) for event in watch.fired("heard")}
        assert heard == {f"agents.robot.{number}.tell": (number, number) for number in range(1, 6)}
        assert watch.groups["robot"].agents[5].knowledge_database["robot.0"]["alarm"] == "fire"

    def test_it_dies_when_its_time_is_over(self):
        assert len(self.flood(6, 10, time_to_live=3).fired("heard")) == 3

    def test_what_comes_another_way_is_suppressed(self):
        watch = self.flood(8, 10, Complete)
        assert len(watch.fired("heard")) == 7
        # The first tells 7; each of these tells all but the first and itself, once.
        assert watch.simulation.exchange.sent == 7 + 7 * 6

    def test_copies_and_delays_change_nothing_of_that(self):
        channel = {"duplication": 0.5, "delay": {"exponential": 0.1}}
        assert len(self.flood(8, 60, Ring, channel).fired("heard")) == 7


def consensus(topology, gain, steps, count=12, channel=None, **parameters):
    """The values of all agents at each turn, and the eigenvalues of the Laplacian."""
    first = np.random.default_rng(5).uniform(0, 10, count)
    knowledge = [{"value": float(each)} for each in first]
    agree = made(Consensus, gain=gain)
    watch = Watch({"node": Team({"agree": agree}, count=count, knowledge=knowledge)}, topology, channel, **parameters)
    group = watch.groups["node"]
    watch.run(steps, lambda: [known["value"] for known in group.knowledge])
    links = watch.simulation.exchange.network.links
    adjacency = np.zeros((count, count))
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
    def test_values_follow_the_laplacian_exactly(self, topology, gain, parameters):
        values, laplacian, _ = consensus(topology, gain, 60, **parameters)
        expected = [values[0]]
        for _ in values[1:]:
            expected.append(expected[-1] - gain * laplacian @ expected[-1])
        assert np.allclose(values, expected, atol=1e-12)

    @pytest.mark.parametrize("loss", [0.0, 0.2])
    @pytest.mark.parametrize(("topology", "gain", "parameters"), GRAPHS)
    def test_all_come_to_the_mean_as_fast_as_the_laplacian_says(self, topology, gain, parameters, loss):
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

    def test_vectors_are_agreed_on_element_by_element(self):
        knowledge = [{"value": [float(row), -2.0 * row]} for row in range(5)]
        watch = Watch({"node": Team({"agree": made(Consensus, gain=0.3)}, count=5, knowledge=knowledge)}, Ring)
        watch.run(200)
        assert np.allclose([known["value"] for known in watch.groups["node"].knowledge], [2.0, -4.0], atol=1e-9)

    def test_groups_agree_with_each_other(self):
        teams = {
            name: Team({"agree": made(Consensus, gain=0.3)}, count=3, knowledge=[{"value": value}] * 3)
            for name, value in (("cat", 1.0), ("dog", 3.0))
        }
        watch = Watch(teams, Ring).run(300)
        values = [known["value"] for group in watch.groups.values() for known in group.knowledge]
        assert np.allclose(values, 2.0, atol=1e-9)
