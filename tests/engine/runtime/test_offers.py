"""Specifications that arrive while a run goes on are announced, accepted, monitored, given up and rejected."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli import SimulationState, check_log, load, open_log, sweep
from symaware_cli.engine.runtime.run_summary import RunSummary
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log.digest import digest
from symaware_cli.log.reader import Log
from symaware_cli.processes.distribution import participant
from symaware_cli.processes.distribution_error import DistributionError
from symaware_cli.processes.place import Place

Ran = Callable[..., tuple[RunSummary, Log]]

#: Two robots on a line that drive to what they have accepted, and an operator; a step takes 0.5 s.
SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "errands",
    "run": {"duration": 10.0},
    "environment": {"use": "kinematic", "with": {"time_step": 0.5}},
    "regions": {"west": {"box": [-1, 1, -1, 1]}, "east": {"box": [9, 11, -1, 1]}},
    "agents": {
        "operator": {
            "model": {"use": "single-integrator"},
            "state": [5, 5],
            "components": {"tell": {"use": "communication.flooding", "with": {"names": ["offers"]}}},
        },
        "robot": {
            "count": 2,
            "model": {"use": "single-integrator"},
            "state": [[3.5, 0], [6, 0]],
            "knowledge": {"goal": [[3.5, 0], [6, 0]]},
            "components": {
                "see": {"use": "perception.self"},
                "hear": {"use": "communication.flooding"},
                "take": {"use": "allocation.nearest", "with": {"least": -5.2}},
                "drive": {"use": "control.go-to-goal", "with": {"speed": 1.0, "gain": 10.0}},
            },
        },
    },
}
EAST = {
    "each": "robot",
    "offer": {"at": 2.0, "to": "operator", "epsilon": 0.1, "knowledge": {"goal": [10, 0]}},
    "formula": "eventually[0, 5] inside(position, east)",
}
WEST = {**EAST, "offer": {"at": 1.0, "knowledge": {"goal": [0, 0]}}, "formula": "eventually inside(position, west)"}


@pytest.fixture
def ran(tmp_path: Path) -> Ran:
    def run(specifications: dict[str, Any], name: str = "errands", **changes: Any) -> tuple[RunSummary, Log]:
        document = {**SCENARIO, "specifications": specifications, **changes}
        (tmp_path / "errands.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
        summary = execute(build(tmp_path / "errands.yaml"), tmp_path / f"{name}.mcap")
        return summary, open_log(tmp_path / f"{name}.mcap")

    return run


def history(log: Log, name: str) -> list[tuple[float, str, str]]:
    """When what happened to a specification, and to whom."""
    return [
        (event.time / 1e9, event.name, event.data.get("agent", ""))
        for event in log.events()
        if event.source == f"specifications.{name}" and event.name not in ("satisfied", "violated")
    ]


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_an_offer_of_an_operator_is_accepted_and_monitored_from_then_on(ran: Ran, mode: str) -> None:
    summary, log = ran({"east": EAST}, run={"duration": 10.0, "mode": mode})
    # The operator tells of it in the step of the offer; a message is read one step later.
    assert history(log, "east") == [(2.0, "offered", ""), (2.5, "accepted", "robot.1")]
    (outcome,) = summary.specifications
    assert (outcome.verdict, outcome.agents, outcome.counts["satisfied"]) == ("satisfied", ("robot.1",), 1)
    # It is 3 m to the region for robot.1, which sets out at 2.5 s and has 4.5 s left: 1 m within by 6.5 s.
    assert outcome.robustness == pytest.approx(1.0)
    assert log.outcomes == summary.specifications
    assert log.specifications["east"].begun.tolist() == [False, True]


@pytest.mark.parametrize("formula", ["eventually[0, 5] inside(position, east)", "always x < 8", "eventually x > 12"])
def test_a_check_of_the_log_comes_to_the_same(ran: Ran, formula: str) -> None:
    summary, log = ran(
        {
            "east": {**EAST, "formula": formula},
            "west": WEST,
            "apart": {"pairs": "robot", "formula": "always distance > 1"},
        }
    )
    assert check_log(log.path).specifications == summary.specifications


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_runs_repeat_byte_for_byte(ran: Ran, mode: str) -> None:
    run = {"duration": 10.0, "mode": mode}
    first, again = (ran({"east": EAST, "west": WEST}, name, run=run)[1] for name in ("first", "again"))
    assert digest(first) == digest(again)


def test_agents_that_receive_no_offer_accept_nothing(ran: Ran) -> None:
    silent = json.loads(json.dumps(SCENARIO["agents"]))
    del silent["robot"]["components"]["hear"]
    summary, log = ran({"east": EAST}, agents=silent)
    assert history(log, "east") == [(2.0, "offered", ""), (10.0, "rejected", "")]
    assert summary.specifications[0].verdict == "rejected"


def test_an_offer_that_no_agent_accepts_in_time_is_rejected(ran: Ran) -> None:
    far = {**EAST, "offer": {"at": 2.0, "to": "operator", "open_for": 2.0}, "formula": "eventually x > 50"}
    summary, log = ran({"far": far})
    assert history(log, "far") == [(2.0, "offered", ""), (4.5, "rejected", "")]
    assert str(summary.specifications[0]) == "far: nobody has accepted it by 4 s"
    assert log.outcomes == check_log(log.path).specifications == summary.specifications


def test_the_specification_of_a_stopped_agent_is_open_again_and_time_goes_on(ran: Ran) -> None:
    slow = {
        **EAST,
        "formula": "eventually[0, 8] inside(position, west)",
        "offer": {"at": 1.0, "knowledge": {"goal": [0, 0]}},
    }
    faults = {"crash": {"stop": "robot.0", "at": 2.0}}
    summary, log = ran({"west": slow}, faults=faults)
    # Both are told at once; robot.0 has its turn first. The other is 5 m away, and arrives 5 s later, after 8.5 s.
    assert history(log, "west") == [
        (1.0, "offered", ""),
        (1.0, "accepted", "robot.0"),
        (2.5, "released", "robot.0"),
        (2.5, "accepted", "robot.1"),
    ]
    assert summary.specifications[0].verdict == "satisfied"
    assert summary.specifications[0].agents == ("robot.1",)
    assert log.specifications["west"].begun.tolist() == [False, True]
    assert check_log(log.path).specifications == summary.specifications
    late, _ = ran({"west": {**slow, "formula": "eventually[0, 5] inside(position, west)"}}, "late", faults=faults)
    assert late.specifications[0].verdict == "violated"


def test_decisions_before_a_failure_stay(ran: Ran) -> None:
    there = {**EAST, "formula": "eventually x < 3.2", "offer": {"at": 1.0, "knowledge": {"goal": [0, 0]}}}
    summary, log = ran({"there": there}, faults={"crash": {"stop": "robot.0", "at": 6.0}})
    assert [name for _, name, _ in history(log, "there")] == ["offered", "accepted"]
    assert summary.specifications[0].verdict == "satisfied"


def test_an_agent_that_leaves_gives_up_its_accepted_specifications(ran: Ran) -> None:
    agents = json.loads(json.dumps(SCENARIO["agents"]))
    agents["robot"]["present"] = [{"until": 3.0}, {}]
    summary, log = ran({"west": WEST}, agents=agents)
    assert history(log, "west")[1:] == [
        (1.0, "accepted", "robot.0"),
        (3.0, "released", "robot.0"),
        (3.0, "accepted", "robot.1"),
    ]
    assert check_log(log.path).specifications == summary.specifications


def test_an_event_brings_an_offer_at_the_next_step(ran: Ran) -> None:
    there = {"at": {"event": "goal-reached", "of": "agents.robot.1.drive"}, "knowledge": {"goal": [10, 0]}}
    summary, log = ran({"west": WEST, "east": {**EAST, "offer": there}})
    assert history(log, "east")[0] == (0.5, "offered", "")
    assert [each.verdict for each in summary.specifications] == ["satisfied", "satisfied"]
    assert check_log(log.path).specifications == summary.specifications


def test_a_component_takes_turns_when_something_is_open_again(ran: Ran) -> None:
    agents = json.loads(json.dumps(SCENARIO["agents"]))
    agents["robot"]["components"]["take"]["trigger"] = {"event": "released", "of": "specifications.*"}
    summary, _ = ran({"west": WEST}, agents=agents)
    assert summary.specifications[0].verdict == "rejected"


def test_the_log_has_who_accepted_each_specification_with_which_risk(ran: Ran) -> None:
    _, log = ran({"east": EAST})
    (event,) = (event for event in log.events() if event.name == "accepted")
    assert event.data == {"agent": "robot.1", "by": "agents.robot.1.take", "epsilon": 0.1, "specification": "east"}


@pytest.mark.parametrize("steps", [5, 7, 13])
def test_a_state_has_the_offers_and_their_holders(tmp_path: Path, steps: int) -> None:
    document = {**SCENARIO, "specifications": {"east": EAST, "west": WEST}, "run": {"duration": 10.0}}
    (tmp_path / "errands.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
    scenario = load(tmp_path / "errands.yaml")
    with scenario.start() as simulation:
        simulation.step(steps)
        data = simulation.capture().to_bytes()
        simulation.step(20)
        expected = simulation.result.summary.specifications
    with scenario.start() as other:
        other.restore(SimulationState.from_bytes(data))
        other.step(20)
        assert other.result.summary.specifications == expected
    assert [each.verdict for each in expected] == ["satisfied", "satisfied"]


def test_a_component_in_a_worker_process_has_what_the_run_tells_its_agent(ran: Ran) -> None:
    agents = json.loads(json.dumps(SCENARIO["agents"]))
    here, _ = ran({"west": WEST}, agents=agents)
    agents["robot"]["components"]["take"]["run_in"] = "process"
    there, log = ran({"west": WEST}, "process", agents=agents)
    assert there.specifications == here.specifications
    assert check_log(log.path).specifications == there.specifications


def test_offers_are_refused_in_runs_of_several_processes(tmp_path: Path) -> None:
    (tmp_path / "errands.yaml").write_text(yaml.safe_dump({**SCENARIO, "specifications": {"west": WEST}}))
    place = Place("host", "127.0.0.1:0", only=("agents.robot",))
    with pytest.raises(DistributionError, match="the specification `west` is offered while the run goes on"):
        participant(build(tmp_path / "errands.yaml"), place)


def test_a_sweep_has_the_verdict_on_the_agents_that_accepted(tmp_path: Path) -> None:
    document = {**SCENARIO, "specifications": {"east": EAST, "far": {**EAST, "formula": "eventually x > 50"}}}
    (tmp_path / "errands.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
    (row,) = sweep(tmp_path / "errands.yaml", tmp_path / "sweep", runs=1, jobs=1).to_pylist()
    assert (row["verdict.east"], row["verdict.far"]) == ("satisfied", "rejected")
    assert row["robustness.east"] == pytest.approx(1.0)
    assert [each["agent"] for each in row["by_agent.east"]] == ["robot.1"]


def test_it_is_undecided_in_the_instant_of_its_acceptance(ran: Ran) -> None:
    summary, _ = ran({"west": WEST}, run={"duration": 10.0, "until": "satisfied.west or time >= 2"})
    assert summary.simulated_time == 2.0
    assert summary.specifications[0].verdict == "violated"
