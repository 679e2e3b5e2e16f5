"""Who asks comes to know what others know, and is told where they do not."""

import itertools

import pytest
from simulating import STEP, Team
from talking import Watch, made

from symaware_cli.engine.components.communication.request import Request
from symaware_cli.engine.network.network import Network, TopologyPhase
from symaware_cli.engine.network.topology.fixed import Complete


class TestRequests:
    def teams(self, **ask: float) -> dict[str, Team]:
        asking = made(Request, whom=("robot.*",), names=("goal",), **ask)
        return {
            "boss": Team({"ask": asking}, count=1),
            "robot": Team({"answer": Request}, count=2, knowledge=[{"goal": 1}, {"goal": "north", "secret": 2}]),
        }

    def test_an_agent_that_is_asked_answers_from_its_knowledge(self) -> None:
        watch = Watch(self.teams()).run(10)
        known = watch.groups["boss"].agents[0].knowledge_database
        assert (dict(known["robot.0"]), dict(known["robot.1"])) == ({"goal": 1}, {"goal": "north"})
        assert [(event.time, event.data["other"]) for event in watch.fired("answered")] == [
            (2 * STEP, "robot.0"),
            (2 * STEP, "robot.1"),
        ]

    def test_an_agent_that_does_not_answer_is_asked_again(self) -> None:
        watch = Watch(self.teams(timeout=0.2, tries=100), Complete, {"loss": 0.6}).run(300)
        assert {event.data["other"] for event in watch.fired("answered")} == {"robot.0", "robot.1"}
        assert watch.simulation.exchange.sent > 4

    def test_at_last_it_is_given_up(self) -> None:
        watch = Watch(self.teams(timeout=0.2, tries=3), Complete, {"loss": 1.0}).run(60)
        assert [event.data["other"] for event in watch.fired("unanswered")] == ["robot.0", "robot.1"]
        assert watch.simulation.exchange.sent == 6

    def test_answers_can_be_kept_up_to_date(self) -> None:
        watch = Watch(self.teams(interval=0.5)).run(60)
        assert len(watch.fired("answered")) == 2 * 5

    def test_an_agent_that_was_given_up_is_asked_again_after_the_interval(self) -> None:
        # The links of the first 3 s lose everything.
        watch = Watch(self.teams(timeout=0.2, tries=3, interval=2.0), Complete, {"loss": 1.0})
        lost = watch.simulation.exchange.network
        roster = watch.simulation.environment.roster
        made = Complete(Complete.Parameters())
        made.initialise(watch.simulation.environment, 7)

        def heal() -> None:
            if watch.simulation.clock.now == 60 * STEP:
                watch.simulation.connect(Network(roster, [TopologyPhase(0, made)]))

        assert lost is not None
        watch.run(140, heal)
        assert [event.time // STEP for event in watch.fired("unanswered")] == [12, 12, 64, 64]
        assert {event.time // STEP for event in watch.fired("answered")} == {106}

    def test_without_an_interval_it_is_for_good(self) -> None:
        watch = Watch(self.teams(timeout=0.2, tries=3), Complete, {"loss": 1.0}).run(200)
        assert watch.simulation.exchange.sent == 6

    @pytest.mark.parametrize("seed", [1, 2, 4])
    def test_each_question_of_an_agent_has_its_own_answer(self, seed: int) -> None:
        ask = {name: made(Request, whom=("c",), names=(name,), timeout=0.2, tries=50) for name in ("value", "other")}
        teams = {"a": Team(ask), "c": Team({"answer": Request}, knowledge=[{"value": 2.0, "other": 3.0}])}
        watch = Watch(teams, Complete, {"loss": 0.5, "delay": {"uniform": [0.0, 0.5]}}, seed=seed).run(200)
        answers = {event.source: event.data["names"] for event in watch.fired("answered")}
        assert answers == {"agents.a.value": ["value"], "agents.a.other": ["other"]}
        assert watch.groups["a"].agents[0].knowledge_database["c"] == {"value": 2.0, "other": 3.0}

    def test_an_answer_to_an_earlier_question_is_none_to_a_later_one(self) -> None:
        # Between two answers of one there is the interval, and the way there and back.
        channel = {"delay": {"uniform": [0.1, 1.5]}, "duplication": 0.5}
        watch = Watch(self.teams(timeout=0.4, tries=100, interval=0.2), Complete, channel).run(400)
        asked = [(event.time, event.data["other"]) for event in watch.fired("answered")]
        assert len(asked) > 10
        for (one, who), (other, whom) in itertools.combinations(asked, 2):
            assert who != whom or other - one >= 0.4e9

    def test_an_agent_without_the_knowledge_answers_that_it_has_none(self) -> None:
        asking = made(Request, whom=("robot.*",), names=("goal", "gaol"))
        teams = {**self.teams(), "boss": Team({"ask": asking})}
        watch = Watch(teams | {"robot": Team({"answer": Request}, count=2, knowledge=[{"goal": 1}, {}])}).run(10)
        assert [(event.data["other"], event.data["names"]) for event in watch.fired("answered")] == [
            ("robot.0", ["goal"])
        ]
        assert [(event.data["other"], event.data["names"], event.level.name) for event in watch.fired("unknown")] == [
            ("robot.0", ["gaol"], "WARNING"),
            ("robot.1", ["goal", "gaol"], "WARNING"),
        ]

    def test_a_group_can_be_asked(self) -> None:
        teams = {**self.teams(), "boss": Team({"ask": made(Request, whom=("robot",), names=("goal",))})}
        assert len(Watch(teams).run(5).fired("answered")) == 2
