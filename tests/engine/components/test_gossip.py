"""Gossip spreads as fast as theory says, and the later version wins."""

import numpy as np
from simulating import STEP, Team
from talking import Setting, Watch, made, team

from symaware_cli import Agent
from symaware_cli.engine.components.communication.gossip import Gossip
from symaware_cli.engine.faults.restart import Restart
from symaware_cli.engine.network.topology.fixed import Complete
from symaware_cli.engine.runtime.timing import Timing


class TestGossip:
    def test_a_rumour_reaches_a_thousand_in_about_as_many_rounds_as_a_logarithm_says(self) -> None:
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

    def test_a_later_version_takes_the_place_of_an_earlier_one(self) -> None:
        def change(agent: Agent) -> list[float]:
            if agent.row == 3 and agent.surroundings.clock.now == 20 * STEP:
                agent.self_knowledge["rumour"] = "no fire"
            return [0.0, 0.0]

        knowledge = [{"rumour": "fire"}] + [{} for _ in range(9)]
        watch = Watch({"robot": team(10, change, knowledge, tell=Gossip)}, Complete).run(60)
        assert {known["rumour"] for known in watch.groups["robot"].knowledge} == {"no fire"}

    def test_it_gets_through_where_much_is_lost(self) -> None:
        knowledge = [{"rumour": "fire"}] + [{} for _ in range(29)]
        watch = Watch({"robot": Team({"tell": Gossip}, count=30, knowledge=knowledge)}, Complete, {"loss": 0.5})
        watch.run(60)
        assert len(watch.fired("informed")) == 29

    def test_an_agent_that_restarts_does_not_spread_old_values(self) -> None:
        def change(agent: Agent) -> list[float]:
            if agent.id == "robot.0" and agent.surroundings.clock.now == 20 * STEP:
                agent.self_knowledge["rumour"] = "no fire"
            return [0.0, 0.0]

        knowledge = [{"rumour": "fire"}, {}, {}]
        watch = Watch({"robot": team(3, change, knowledge, tell=Gossip)}, Complete)
        # Just after the change; those who heard of the fire have not heard of it yet.
        watch.fault(Restart, "robot", "tell", 21, rows=[1, 2]).run(60)
        assert {known["rumour"] for known in watch.groups["robot"].knowledge} == {"no fire"}

    def test_an_agent_that_restarts_still_spreads_its_own_value(self) -> None:
        def change(agent: Agent) -> list[float]:
            if agent.id == "robot.0" and agent.surroundings.clock.now == 20 * STEP:
                agent.self_knowledge["rumour"] = "no fire"
            return [0.0, 0.0]

        knowledge = [{"rumour": "fire"}, {"rumour": "fire"}]
        watch = Watch({"robot": team(2, change, knowledge, tell=Gossip)}, Complete, {"loss": 0.8})
        watch.fault(Restart, "robot", "tell", 22, rows=[0]).run(90)
        assert {known["rumour"] for known in watch.groups["robot"].knowledge} == {"no fire"}

    def test_initial_knowledge_is_as_old_as_the_run_even_in_components_that_begin_late(self) -> None:
        def change(agent: Agent) -> None:
            if agent.surroundings.clock.now == 5 * STEP:
                agent.self_knowledge["rumour"] = "no fire"

        teams = {
            "early": Team({"tell": Gossip, "act": lambda: Setting(change)}, knowledge=[{"rumour": "fire"}]),
            "late": Team({"tell": Gossip}, knowledge=[{"rumour": "smoke"}], timings={"tell": Timing(offset=20 * STEP)}),
        }
        watch = Watch(teams, Complete).run(60)
        assert {group.knowledge[0]["rumour"] for group in watch.groups.values()} == {"no fire"}

    def test_a_list_that_grows_is_news_and_an_equal_number_is_not(self) -> None:
        def write(agent: Agent) -> list[float]:
            known = agent.self_knowledge
            if agent.row == 0 and agent.surroundings.clock.now == 10 * STEP:
                known["items"] = [*known["items"], 2]
            if agent.row == 0:
                known["level"] = float("1000.5")
            return [0.0, 0.0]

        knowledge = [{"items": [1], "level": 1000.5}, {}]
        tell = {name: made(Gossip, name=name) for name in ("items", "level")}
        watch = Watch({"robot": team(2, write, knowledge, **tell)}, Complete).run(40)
        assert watch.groups["robot"].knowledge[1]["items"] == [1, 2]
        informed = [(event.source.rpartition(".")[2], event.time // STEP) for event in watch.fired("informed")]
        assert informed == [("items", 1), ("level", 1), ("items", 12)]
