"""Agents bid for what is offered by messages; nothing that is lost or fails makes an auction hang."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli import Log, SimulationState, check_log, load, open_log
from symaware_cli.log.digest import digest

Ran = Callable[..., Log]

#: Robots on a line between two shelves; a step takes 0.5 s, and so does a message.
ROBOTS: dict[str, Any] = {
    "count": 3,
    "model": {"use": "single-integrator"},
    "state": [[2, 0], [4, 0], [9, 0]],
    "knowledge": {"goal": [[2, 0], [4, 0], [9, 0]]},
    "components": {
        "see": {"use": "perception.self"},
        "auction": {"use": "allocation.auction", "with": {"deadline": 1.0}},
        "drive": {"use": "control.go-to-goal", "with": {"speed": 1.0}},
    },
}
NORTH: dict[str, Any] = {
    "each": "robot",
    "offer": {"at": 1.0, "epsilon": 0.1, "knowledge": {"goal": [2.9, 3]}},
    "formula": "eventually[0, 12] inside(position, north)",
}
SOUTH: dict[str, Any] = {
    "each": "robot",
    "offer": {"at": 1.0, "epsilon": 0.1, "knowledge": {"goal": [1, -3]}},
    "formula": "eventually[0, 12] inside(position, south)",
}
BOTH = {"north": NORTH, "south": SOUTH}


@pytest.fixture
def ran(tmp_path: Path) -> Ran:
    def run(specifications: dict[str, Any], name: str = "auction", **changes: Any) -> Log:
        scenario = written(tmp_path / f"{name}.yaml", specifications, **changes)
        load(scenario).run(output=tmp_path / f"{name}.mcap")
        return open_log(tmp_path / f"{name}.mcap")

    return run


def written(path: Path, specifications: dict[str, Any], **changes: Any) -> Path:
    parameters = {"deadline": 1.0} | changes.pop("auction", {})
    components = ROBOTS["components"] | {"auction": {"use": "allocation.auction", "with": parameters}}
    document = {
        "symaware": 1,
        "name": "auction",
        "run": {"duration": 15.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.5}},
        "regions": {"north": {"circle": {"centre": [2.9, 3], "radius": 0.5}}, "south": {"box": [0, 2, -4, -2]}},
        "agents": {"robot": {**ROBOTS, "components": components, **changes.pop("robot", {})}},
        "specifications": specifications,
    }
    path.write_text(yaml.safe_dump({**document, **changes}, sort_keys=False))
    return path


def history(log: Log, *names: str) -> list[tuple[float, str, str]]:
    """When which of some events happened, and what it says."""
    return [(event.time / 1e9, event.name, event.text) for event in log.events() if event.name in names]


def holders(log: Log) -> dict[str, list[tuple[float, str]]]:
    """Who accepted what, and when."""
    found: dict[str, list[tuple[float, str]]] = {}
    for event in log.events():
        if event.name == "accepted":
            found.setdefault(event.data["specification"], []).append((event.time / 1e9, event.data["agent"]))
    return found


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_the_total_of_distances_is_least_and_each_agent_has_one(ran: Ran, mode: str) -> None:
    log = ran(BOTH, run={"duration": 15.0, "mode": mode})
    # robot.0 is nearer to both: 2.63 and 2 m, where robot.1 has 2.70 and 2.83 m.
    ((when, _, text),) = history(log, "assigned")
    assert (when, text) == (2.0, "north to robot.1, south to robot.0")
    # The auctioneer wins, and accepts at once; the other hears of it one step later.
    assert holders(log) == {"south": [(2.0, "robot.0")], "north": [(2.5, "robot.1")]}
    assert [each.verdict for each in log.outcomes] == ["satisfied", "satisfied"]
    assert check_log(log.path).specifications == log.outcomes


def test_in_a_consensus_all_come_to_the_assignment_of_one_auctioneer(ran: Ran) -> None:
    log = ran(BOTH, auction={"decision": "consensus"})
    # One step after bidding ends all know that they agree.
    assert holders(log) == {"south": [(2.5, "robot.0")], "north": [(2.5, "robot.1")]}
    assert len(history(log, "assigned")) == 1


def test_any_agent_can_be_the_auctioneer(ran: Ran) -> None:
    log = ran(BOTH, auction={"auctioneer": "robot.2"})
    assert holders(log) == {"south": [(2.5, "robot.0")], "north": [(2.5, "robot.1")]}
    (event,) = (event for event in log.events() if event.name == "assigned")
    assert event.source == "agents.robot.2.auction"


def test_ties_go_to_the_agent_that_comes_first(ran: Ran) -> None:
    same = {"state": [[4, 0], [4, 0], [4, 0]], "knowledge": {"goal": [[4, 0], [4, 0], [4, 0]]}}
    log = ran({"east": NORTH, "north": NORTH}, robot={**same, "count": 3})
    assert history(log, "assigned")[0][2] == "east to robot.0, north to robot.1"


def test_specifications_beyond_the_number_of_agents_are_auctioned_in_the_next_round(ran: Ran) -> None:
    alone = {"count": 1, "state": [2, 0], "knowledge": {"goal": [2, 0]}}
    log = ran(BOTH, robot=alone)
    assert [(when, name) for when, name, _ in history(log, "assigned", "unassigned")] == [
        (2.0, "assigned"),
        (2.0, "unassigned"),
        (4.0, "assigned"),
    ]
    assert holders(log) == {"south": [(2.0, "robot.0")], "north": [(4.0, "robot.0")]}


def test_an_agent_takes_no_more_than_it_may_hold(ran: Ran) -> None:
    alone = {"count": 1, "state": [2, 0], "knowledge": {"goal": [2, 0]}}
    log = ran(BOTH, robot=alone, auction={"most": 1})
    ((first, _),), ((second, _),) = holders(log)["south"], holders(log)["north"]
    (done, _) = (when for when, _, _ in history(log, "satisfied"))
    assert first == 2.0
    assert done < second <= done + 4.5


def test_only_the_candidates_with_the_highest_robustness_are_considered(ran: Ran) -> None:
    # robot.0 is nearest to both and the only candidate of either, so that one of them stays open.
    log = ran(BOTH, auction={"candidates": 1})
    assert [text for when, _, text in history(log, "assigned", "unassigned") if when == 2.0] == [
        "south to robot.0",
        "no bidder can take `north`",
    ]


def test_as_many_candidates_as_there_are_specifications_are_considered_for_each(ran: Ran) -> None:
    log = ran(BOTH, auction={"candidates": "offered"})
    # Two for two: as without a filter.
    assert holders(log) == {"south": [(2.0, "robot.0")], "north": [(2.5, "robot.1")]}
    alone = ran({"south": SOUTH}, "alone", auction={"candidates": "offered"})
    assert holders(alone) == {"south": [(2.0, "robot.0")]}


def test_an_auctioneer_that_is_dead_is_replaced_in_the_same_round(ran: Ran) -> None:
    log = ran(BOTH, faults={"crash": {"stop": "robot.0", "at": 0.5}})
    assert history(log, "assigned") == [(2.0, "assigned", "north to robot.2, south to robot.1")]
    assert holders(log) == {"south": [(2.0, "robot.1")], "north": [(2.5, "robot.2")]}


@pytest.mark.parametrize("decision", ["auctioneer", "consensus"])
def test_an_auctioneer_that_dies_after_its_bid_delays_the_auction_by_one_round(ran: Ran, decision: str) -> None:
    log = ran(BOTH, auction={"decision": decision}, faults={"crash": {"stop": "robot.0", "at": 1.5}})
    # It has bid by then, so the others leave the first round to it. The next one begins at 3 s.
    accepted = holders(log)
    assert {name: agents[-1][1] for name, agents in accepted.items()} == {"south": "robot.1", "north": "robot.2"}
    assert all(4.0 <= agents[-1][0] <= 4.5 for agents in accepted.values())
    assert check_log(log.path).specifications == log.outcomes


def test_the_specifications_of_a_failed_agent_are_auctioned_again(ran: Ran) -> None:
    log = ran(BOTH, faults={"crash": {"stop": "robot.1", "at": 3.0}})
    (first, again) = holders(log)["north"]
    assert first == (2.5, "robot.1")
    # It is open again at the next step, 3.5 s; the round of that time closes a deadline later.
    assert again[1] in ("robot.0", "robot.2")
    assert 4.5 <= again[0] <= 5.0


def test_an_offer_that_no_agent_can_accept_any_more_is_rejected_by_an_event(ran: Ran) -> None:
    alone = {"count": 1, "state": [2, 0], "knowledge": {"goal": [2, 0]}}
    log = ran({"north": NORTH}, robot=alone, faults={"crash": {"stop": "robot.0", "at": 3.0}})
    assert [name for _, name, _ in history(log, "offered", "accepted", "released", "rejected")] == [
        "offered",
        "accepted",
        "released",
        "rejected",
    ]
    assert log.outcomes[0].verdict == "rejected"


@pytest.mark.parametrize("decision", ["auctioneer", "consensus"])
@pytest.mark.parametrize("loss", [0.3, 0.7])
def test_lost_messages_delay_an_auction_and_give_nothing_to_two(ran: Ran, decision: str, loss: float) -> None:
    for seed in range(4):
        topology = {"use": "complete", "channel": {"loss": loss}}
        log = ran(BOTH, f"{decision}-{seed}", auction={"decision": decision}, topology=topology, seed=seed)
        accepted = holders(log)
        assert all(len(agents) == 1 for agents in accepted.values())
        assert set(accepted) == {"north", "south"}
        assert check_log(log.path).specifications == log.outcomes


def test_agents_that_cannot_hear_each_other_all_assign_and_the_first_has_it(ran: Ran) -> None:
    # All that they learn, late, is what the operator tells them.
    hearing: dict[str, Any] = {"hear": {"use": "communication.flooding"}, **ROBOTS["components"]}
    agents: dict[str, Any] = {
        "operator": {
            "model": {"use": "single-integrator"},
            "state": [5, 5],
            "components": {"tell": {"use": "communication.flooding", "with": {"names": ["offers"]}}},
        },
        "robot": {
            **ROBOTS,
            "components": hearing,
        },
    }
    offer = {**NORTH["offer"], "to": "operator"}
    log = ran({"north": {**NORTH, "offer": offer}}, agents=agents, topology={"use": "star"})
    ((when, agent),) = holders(log)["north"]
    assert (when, agent) == (2.0, "robot.0")
    assert [text for _, _, text in history(log, "refused")] == ["`north` is not open"] * 2


def test_in_a_consensus_an_agent_that_hears_nobody_decides_for_itself(ran: Ran) -> None:
    log = ran(
        {"north": NORTH}, auction={"decision": "consensus"}, topology={"use": "complete", "channel": {"loss": 1.0}}
    )
    assert holders(log) == {"north": [(2.0, "robot.0")]}


def test_bids_and_results_are_passed_on_over_several_hops(ran: Ran) -> None:
    # robot.0 and robot.2 hear each other only by way of robot.1.
    near = {"use": "line"}
    log = ran(BOTH, auction={"auctioneer": "robot.2"}, topology=near)
    assert history(log, "assigned") == [(2.0, "assigned", "north to robot.1, south to robot.0")]
    assert holders(log) == {"south": [(3.0, "robot.0")], "north": [(2.5, "robot.1")]}


def test_an_auctioneer_that_is_no_agent_of_the_group_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "bad.yaml", BOTH, auction={"auctioneer": "robot.7"})
    with pytest.raises(Exception, match=r"the auctioneer `robot.7` is none of its agents"):
        load(path)


def test_a_state_has_the_rounds(tmp_path: Path) -> None:
    scenario = load(written(tmp_path / "auction.yaml", BOTH))
    with scenario.start() as simulation:
        simulation.step(4)
        data = simulation.capture().to_bytes()
        simulation.step(30)
        expected = simulation.result.summary.specifications
    with scenario.start() as other:
        other.restore(SimulationState.from_bytes(data))
        other.step(30)
        assert other.result.summary.specifications == expected
    assert [each.agents for each in expected] == [("robot.1",), ("robot.0",)]


def test_runs_repeat_byte_for_byte_with_any_hash_seed(tmp_path: Path) -> None:
    path = written(tmp_path / "auction.yaml", BOTH, topology={"use": "complete", "channel": {"loss": 0.4}})
    digests = []
    for hash_seed in ("1", "2"):
        log = tmp_path / f"{hash_seed}.mcap"
        command = [sys.executable, "-m", "symaware_cli", "run", str(path), "--output", str(log), "--quiet"]
        subprocess.run(command, check=True, env={**os.environ, "PYTHONHASHSEED": hash_seed})
        digests.append(digest(open_log(log)))
    assert digests[0] == digests[1]
