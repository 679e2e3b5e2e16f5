"""What is flooded reaches everybody once."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from simulating import STEP, Team
from talking import Setting, Watch, made

from symaware_cli.engine.components.communication.flooding import Flooding
from symaware_cli.engine.faults.restart import Restart
from symaware_cli.engine.network.topology.fixed import Complete, FixedTopology, Line, Ring


class TestFlooding:
    def flood(
        self,
        count: int,
        steps: int,
        topology: type[FixedTopology] = Line,
        channel: Mapping[str, Any] | None = None,
        **parameters: int,
    ) -> Watch:
        knowledge = [{"alarm": "fire"}] + [{} for _ in range(count - 1)]
        flooding = made(Flooding, names=("alarm",), **parameters)
        watch = Watch({"robot": Team({"tell": flooding}, count=count, knowledge=knowledge)}, topology, channel)
        return watch.run(steps)

    def test_flooded_messages_pass_from_agent_to_agent(self) -> None:
        watch = self.flood(6, 10)
        heard = {event.source: (event.time // STEP, event.data["hops"]) for event in watch.fired("heard")}
        assert heard == {f"agents.robot.{number}.tell": (number, number) for number in range(1, 6)}
        assert watch.groups["robot"].agents[5].knowledge_database["robot.0"]["alarm"] == "fire"

    def test_it_dies_when_its_time_is_over(self) -> None:
        assert len(self.flood(6, 10, time_to_live=3).fired("heard")) == 3

    def test_a_copy_over_another_path_is_suppressed(self) -> None:
        watch = self.flood(8, 10, Complete)
        assert len(watch.fired("heard")) == 7
        # The first tells 7; each of these tells all but the first and itself, once.
        assert watch.simulation.exchange.sent == 7 + 7 * 6

    def test_copies_and_delays_change_nothing_of_that(self) -> None:
        channel = {"duplication": 0.5, "delay": {"exponential": 0.1}}
        assert len(self.flood(8, 60, Ring, channel).fired("heard")) == 7

    @pytest.mark.parametrize("who", ["origin", "other"])
    def test_messages_after_a_restart_are_received(self, who: str) -> None:
        teams = {
            "origin": Team({"tell": made(Flooding, names=("alarm",), interval=0.5)}, knowledge=[{"alarm": "fire"}]),
            "other": Team({"tell": Flooding}),
        }
        watch = Watch(teams, Complete).fault(Restart, who, "tell", 101).run(200)
        heard = [event.time // STEP for event in watch.fired("heard")]
        expected = {"origin": [*range(1, 102, 10), *range(102, 200, 10)], "other": list(range(1, 200, 10))}
        assert heard == expected[who]

    def test_two_components_of_an_agent_are_heard_of_both(self) -> None:
        knowledge = [{"alarm": "fire", "goal": 1.0}]
        tell = {name: made(Flooding, names=(name,)) for name in ("alarm", "goal")}
        watch = Watch({"origin": Team(tell, knowledge=knowledge), "other": Team({"hear": Flooding})}).run(5)
        assert watch.groups["other"].agents[0].knowledge_database["origin"] == knowledge[0]


class TestNews:
    """What has changed is told again, what has not is not, whatever kind of value it is."""

    @pytest.mark.parametrize(
        ("first", "write", "times"),
        [
            (1000.5, lambda known: known.update(value=float("1000.5")), 1),
            (float("nan"), lambda known: known.update(value=float("nan")), 1),
            ([1, "x"], lambda known: known.update(value=[*known["value"], 2]), 40),
            ([1, "x"], lambda known: known.update(value=[1, "x"]), 1),
            ([[1], {"a": [2]}], lambda known: known.update(value=[[1], {"a": [*known["value"][1]["a"], 3]}]), 40),
            (0, lambda known: known.update(value=np.array([1.0, np.nan])), 2),
            (0, lambda known: known.update(value=known["value"] + np.ones(2)), 40),
            (0, lambda known: known.update(value="text"), 2),
        ],
    )
    def test_a_value_is_sent_at_each_change(
        self, first: float | list[Any], write: Callable[..., Any], times: int
    ) -> None:
        team = Team(
            {
                "tell": made(Flooding, names=("value",)),
                "write": lambda: Setting(lambda agent: write(agent.self_knowledge)),
            },
            knowledge=[{"value": first}],
        )
        watch = Watch({"origin": team, "other": Team({"tell": Flooding})}).run(41)
        assert len(watch.fired("heard")) == times
