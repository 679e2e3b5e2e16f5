"""Specifications are monitored while a run goes on, told by events, recorded, and read by agents and conditions."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from symaware_cli import AwarenessVector, open_log
from symaware_cli.engine.runtime.run_summary import RunSummary
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute, prepared
from symaware_cli.language.problem import ScenarioError
from symaware_cli.log.digest import digest
from symaware_cli.log.reader import Log
from symaware_cli.log.symaware_v1_pb2 import Specification
from symaware_cli.specification.scope import nearest_believed

Ran = Callable[..., tuple[RunSummary, Log]]

#: Two robots on a line: robot.0 drives from 0 to 4 m at 1 m/s, robot.1 waits at 6 m.
SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "line",
    "run": {"duration": 5.0},
    "environment": {"use": "kinematic", "with": {"time_step": 0.5}},
    "regions": {"start": {"box": [-1, 1, -1, 1]}, "end": {"circle": {"centre": [4, 0], "radius": 1}}},
    "agents": {
        "robot": {
            "count": 2,
            "model": {"use": "single-integrator"},
            "state": [[0, 0], [6, 0]],
            "knowledge": {"goal": [[4, 0], [6, 0]]},
            "components": {
                "see": {"use": "perception.omniscient"},
                "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0, "gain": 10.0}},
            },
        },
    },
}


@pytest.fixture
def ran(tmp_path: Path) -> Ran:
    def run(specifications: dict[str, Any], **changes: Any) -> tuple[RunSummary, Log]:
        document = {**SCENARIO, "specifications": specifications, **changes}
        (tmp_path / "line.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
        summary = execute(build(tmp_path / "line.yaml"), tmp_path / "line.mcap")
        return summary, open_log(tmp_path / "line.mcap")

    return run


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
@pytest.mark.parametrize(
    ("specification", "verdict", "counts", "robustness"),
    [
        ({"each": "robot", "formula": "always x >= 0"}, "satisfied", (0, 0, 2), 0.0),
        ({"each": "robot", "formula": "always x > 0"}, "violated", (1, 0, 1), 0.0),
        ({"each": "robot", "formula": "eventually[0, 3] x > 2.5"}, "satisfied", (0, 0, 2), 0.5),
        ({"each": "robot", "formula": "eventually[0, 2] inside(position, end)"}, "violated", (2, 0, 0), -1.0),
        ({"each": "robot", "formula": "eventually[0, 9] x > 5"}, "undecided", (0, 1, 1), None),
        ({"each": "robot", "formula": "always[0, 9] x < 3.5"}, "violated", (2, 0, 0), -2.5),
        ({"pairs": "robot", "formula": "always distance > 1.5"}, "satisfied", (0, 0, 1), 0.5),
        ({"pairs": [["robot.1", "robot.0"]], "formula": "always closing_speed <= 1"}, "satisfied", (0, 0, 1), 0.0),
        ({"formula": "always (min_separation > 1 and agents == 2)"}, "satisfied", (0, 0, 1), 0.0),
        ({"formula": 'eventually position["robot.0"][0] > 3'}, "satisfied", (0, 0, 1), 1.0),
        ({"each": "robot", "of": "belief", "formula": "always nearest > 1"}, "satisfied", (0, 0, 2), 1.0),
        ({"each": "robot", "formula": "x < 1 until x >= 1"}, "satisfied", (0, 0, 2), None),
        ({"each": "robot", "formula": "always (x < 3 implies once[0, 9] x < 0.1)"}, "satisfied", (0, 0, 2), None),
        ({"each": "robot", "from": 2.0, "to": 3.0, "formula": "always x > 1.5"}, "satisfied", (0, 0, 2), 0.5),
    ],
)
def test_outcomes_of_a_specification(
    ran: Ran, mode: str, specification: Any, verdict: str, counts: Any, robustness: float | None
) -> None:
    summary, log = ran({"it": specification}, run={"duration": 5.0, "mode": mode})
    (outcome,) = summary.specifications
    assert outcome.verdict == verdict
    assert tuple(outcome.counts.values()) == counts
    assert summary.violated == (("it",) if verdict == "violated" else ())
    if robustness is not None:
        assert outcome.robustness == pytest.approx(robustness)
    logged = log.specifications["it"]
    assert logged.formula == outcome.formula
    assert [int((logged.verdict == each).sum()) for each in (-1, 0, 1)] == list(outcome.counts.values())
    events = [event for event in log.events() if event.name in ("violated", "satisfied")]
    assert len(events) == outcome.counts["violated"] + outcome.counts["satisfied"]


@pytest.mark.parametrize(
    ("formula", "verdict", "counts"),
    [
        ("always (x > 0.9 implies eventually inside(position, end))", "violated", (1, 0, 1)),
        ("always (x > 0.9 implies eventually inside(position, end)) or x > 5", "satisfied", (0, 0, 2)),
        ("next next x > 0.9", "satisfied", (0, 0, 2)),
        ("inside(position, start) until x > 1", "satisfied", (0, 0, 2)),
    ],
)
def test_linear_temporal_logic(ran: Ran, formula: str, verdict: str, counts: tuple[int, ...]) -> None:
    summary, log = ran({"it": {"each": "robot", "logic": "ltl", "formula": formula}})
    (outcome,) = summary.specifications
    assert (outcome.verdict, tuple(outcome.counts.values())) == (verdict, counts)
    assert outcome.robustness is None
    assert [int((log.specifications["it"].verdict == each).sum()) for each in (-1, 0, 1)] == list(counts)


def test_undecided_specifications_are_presumed_where_a_run_breaks_off(tmp_path: Path) -> None:
    stated = {"it": {"each": "robot", "logic": "ltl", "formula": "always (x < 1 or eventually x > 3.9)"}}
    (tmp_path / "line.yaml").write_text(yaml.safe_dump({**SCENARIO, "specifications": stated}, sort_keys=False))
    with prepared(build(tmp_path / "line.yaml"), tmp_path / "line.mcap", may_exit=False) as run:
        presumed = []
        for steps in (1, 3):
            run.advance(steps)
            presumed.append(run.summary.specifications[0].presumably)
        run.leave("enough")
    assert presumed == ["satisfied", "violated"]
    assert str(run.summary.specifications[0]) == "it by 2 of 2, presumably violated"
    log = open_log(tmp_path / "line.mcap")
    assert log.outcomes == run.summary.specifications
    assert log.specifications["it"].presumptions.tolist()[-1] == [-1, 1]


@pytest.mark.parametrize("formula", ["always[0, 3] x < 9", "once x > 1"])
def test_formulas_beyond_linear_temporal_logic_are_refused(tmp_path: Path, formula: str) -> None:
    stated = {"it": {"each": "robot", "logic": "ltl", "formula": formula}}
    (tmp_path / "line.yaml").write_text(yaml.safe_dump({**SCENARIO, "specifications": stated}, sort_keys=False))
    with pytest.raises(ScenarioError, match="linear temporal logic has no windows, and no operators about the past"):
        build(tmp_path / "line.yaml")


def test_a_verdict_is_announced_as_soon_as_it_is_decided_with_its_reason(ran: Ran) -> None:
    formula = "always ((x > 1.2 and x < 5) implies eventually[0, 1] inside(position, end))"
    _, log = ran({"slow": {"each": "robot", "formula": formula}})
    (told,) = [event for event in log.events() if event.name == "violated"]
    # At 1.5 s x is 1.5 m, and a second later the end is still .5 m away: the premise would have to change by .3 m only.
    assert told.time == 2_500_000_000
    assert told.source == "specifications.slow"
    assert told.data["agents"] == ["robot.0"]
    assert told.data["predicate"] == "x > 1.2"
    assert told.data["robustness"] == pytest.approx(0.3)
    assert "`x > 1.2` holds by 0.3 at 1.5 s" in told.text


def test_the_interval_narrows_to_the_robustness(ran: Ran) -> None:
    _, log = ran({"it": {"each": "robot", "formula": "always[0, 3] x < 5"}})
    logged = log.specifications["it"]
    assert (logged.lower[1:] >= logged.lower[:-1]).all()
    assert (logged.upper[1:] <= logged.upper[:-1]).all()
    np.testing.assert_allclose(logged.lower[-1], [2, -1])
    np.testing.assert_allclose(logged.upper[-1], [2, -1])
    np.testing.assert_allclose(logged.upper[0], [5, -1])
    # Exact values come when they are known, and belong to their own instants.
    assert logged.instants.tolist() == [0, 500_000_000, 1_000_000_000, 1_500_000_000, 2_000_000_000]
    np.testing.assert_allclose(logged.robustness[:, 0], [2, 1.5, 1, 1, 1])


def test_without_intervals_verdicts_are_the_same(ran: Ran) -> None:
    formula = "always[0, 2] (x < 1 or eventually[0, 1] inside(position, end))"
    found = []
    for interval in (True, False):
        summary, log = ran({"it": {"each": "robot", "formula": formula, "interval": interval}})
        told = [(event.time, event.text) for event in log.events() if event.name in ("violated", "satisfied")]
        found.append((summary.specifications[0].counts, told, log.specifications["it"].robustness.tolist()))
    assert found[0] == found[1]


def test_a_violation_may_end_the_run(ran: Ran) -> None:
    summary, log = ran({"near": {"pairs": "robot", "formula": "always distance > 4", "on_violation": "end"}})
    assert summary.simulated_time == 2.0
    assert summary.status == "finished"
    assert list(log.events())[-1].text == "4 steps made; `near` is violated"


def test_a_violation_may_be_a_warning(ran: Ran) -> None:
    _, log = ran({"near": {"pairs": "robot", "formula": "always distance > 4", "on_violation": "event"}})
    assert [event.level for event in log.events() if event.name == "violated"] == ["WARNING"]


def test_specifications_change_nothing_else_in_the_log(ran: Ran) -> None:
    def rest(log: Log) -> dict[str, list[tuple[int, bytes]]]:
        topics = [topic for topic in log.channels if not topic.startswith(("/specifications", "/timing", "/events"))]
        return {topic: [(each.time, each.data) for each in log.messages(topic)] for topic in topics}

    _, plain = ran({})
    before = rest(plain)
    _, stated = ran(
        {
            "apart": {"pairs": "robot", "formula": "always distance > 4"},
            "safe": {"each": "robot", "of": "belief", "formula": "always (risk < 1 and speed < 3)"},
        }
    )
    assert rest(stated) == before


def test_runs_with_specifications_repeat_byte_for_byte(ran: Ran) -> None:
    stated = {"apart": {"pairs": "robot", "formula": "always[0, 3] (distance > 4 or eventually[0, 1] time > 2)"}}
    assert digest(ran(stated)[1]) == digest(ran(stated)[1])


def test_an_instance_begins_with_each_event(ran: Ran) -> None:
    summary, log = ran(
        {
            "rest": {
                "each": "robot",
                "from": {"event": "goal-reached", "of": "steer"},
                "formula": "always[0, 1] speed < 2",
            }
        }
    )
    assert summary.specifications[0].verdict == "satisfied"
    told = {event.data["agents"][0]: event.time for event in log.events() if event.name == "satisfied"}
    reached = {
        event.source.removeprefix("agents.").removesuffix(".steer"): event.time
        for event in log.events()
        if event.name == "goal-reached"
    }
    assert reached.keys() == told.keys() == {"robot.0", "robot.1"}
    for agent, time in told.items():
        assert time >= reached[agent] + 1_000_000_000


def test_monitors_begin_and_end_with_their_agents(ran: Ran) -> None:
    agents = {"robot": {**SCENARIO["agents"]["robot"], "present": [{"from": 1.0, "until": 3.0}, {}]}}
    summary, log = ran(
        {
            "still": {"each": "robot", "formula": "always x < 2.2"},
            "apart": {"pairs": "robot", "formula": "always distance > 1"},
            "there": {"each": "robot", "formula": "eventually[0, 4] x > 9"},
        },
        agents=agents,
    )
    by_name = {each.name: each for each in summary.specifications}
    # robot.0 enters at 1 s in 0 m and has come to 2 m as it leaves.
    assert by_name["still"].counts == {"violated": 1, "undecided": 0, "satisfied": 1}
    assert by_name["apart"].verdict == "satisfied"
    assert by_name["there"].counts == {"violated": 1, "undecided": 1, "satisfied": 0}
    left = [event for event in log.events() if event.name == "satisfied" and event.data["agents"] == ["robot.0"]]
    assert [event.time for event in left] == [3_000_000_000]


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize(
    "formula",
    [
        "always[0, 1] (x < -9 or eventually[0, 2] x > 9)",
        "always[0, 4] (x > 9 implies eventually[0, 1] x < 9)",
        "eventually[0, 4] always[0, 3] x > -9",
        "x < 9 until[0, 4] x > 9",
        "always (x > 9 or once[0, 2] x < 9)",
    ],
)
def test_the_only_agents_of_a_formula_may_leave(ran: Ran, formula: str, count: int) -> None:
    guest = {"count": count, "model": {"use": "single-integrator"}, "state": [0, 0], "present": {"until": 3.0}}
    summary, _ = ran({"any": {"each": "guest", "formula": formula}}, agents={**SCENARIO["agents"], "guest": guest})
    assert summary.status == "finished"
    assert sum(summary.specifications[0].counts.values()) == count


def test_a_specification_without_a_value_fails_the_run(ran: Ran) -> None:
    summary, _ = ran({"odd": {"each": "robot", "formula": "always 1 / (x - 6) < 9"}})
    assert summary.status == "failed"
    assert "specifications.odd" in str(summary.failure)
    assert "`1 / (x - 6) < 9` has no value" in str(summary.failure)


@pytest.mark.parametrize(
    ("condition", "reached"),
    [
        # The status is that of the step before: at 2 s the two are 4 m apart, and the turn at 2.5 s knows.
        ('not violated["apart"]', 2.5),
        ("not inside(position, end)", 3.0),
        ('robustness["early"] > 0', 3.5),
        ('not satisfied["early"]', 1.5),
    ],
)
def test_conditions_read_regions_and_specifications(ran: Ran, condition: str, reached: float) -> None:
    robot = SCENARIO["agents"]["robot"]
    steer = {"use": "control.go-to-goal", "with": {"speed": 1.0, "gain": 10.0}, "condition": condition}
    brake = {"use": "control.go-to-goal", "with": {"speed": 1e-9}, "condition": f"not ({condition})"}
    agents = {
        "robot": {**robot, "components": {"see": {"use": "perception.omniscient"}, "steer": steer, "brake": brake}}
    }
    stated = {
        "apart": {"pairs": "robot", "formula": "always distance > 4"},
        "early": {"each": "robot", "formula": "always[0, 1] x < 9"},
    }
    _, log = ran(stated, agents=agents)
    assert log.series("robot.0", "world").values[-1, 0] == pytest.approx(reached, abs=1e-6)


def test_a_run_ends_when_a_specification_says_so(ran: Ran) -> None:
    stated = {"apart": {"pairs": "robot", "formula": "always distance > 4"}}
    summary, _ = ran(stated, run={"duration": 5.0, "until": 'violated["apart"]'})
    assert summary.simulated_time == 2.0
    summary, _ = ran(stated, run={"duration": 5.0, "until": 'inside(position["robot.0"], end)'})
    assert summary.simulated_time == 3.0


def test_the_nearest_that_an_agent_knows_from_itself_counts_like_one_that_its_group_perceives(tmp_path: Path) -> None:
    (tmp_path / "line.yaml").write_text(yaml.safe_dump(SCENARIO))
    built = build(tmp_path / "line.yaml")
    (group,) = built.simulation.groups
    with prepared(built, None) as run:
        run.advance(1)
        world = group.awareness.world
        assert world is not None
        assert [nearest_believed(group, row) for row in range(2)] == [6.0, 6.0]
        group.agents[0].awareness_database["robot.1"] = AwarenessVector("robot.1", np.array([2.0, 0.0]))
        group.agents[1].awareness_database.world = world
        assert [nearest_believed(group, row) for row in range(2)] == [2.0, 6.0]


def test_robustness_that_leaving_makes_known_is_recorded_at_once_though_nobody_is_left(ran: Ran) -> None:
    agents = {"robot": {**SCENARIO["agents"]["robot"], "present": {"until": 1.0}}}
    agents["other"] = {"model": {"use": "single-integrator"}, "state": [0.0, 5.0]}
    _, log = ran({"right": {"each": "robot", "formula": "always x >= 0"}}, agents=agents)
    found = [(each.time / 1e9, Specification.FromString(each.data)) for each in log.messages("/specifications/right")]
    exact = {time: list(message.robustness) for time, message in found if message.robustness}
    assert list(exact) == [1.0]
    assert exact[1.0][:2] == [0.0, 6.0]


def test_results_that_are_read_late_are_those_that_are_read_at_each_step(tmp_path: Path) -> None:
    agents = {"robot": {**SCENARIO["agents"]["robot"], "present": {"until": 2.0}}}
    stated = {"apart": {"each": "robot", "formula": "always nearest > 1"}}
    (tmp_path / "line.yaml").write_text(yaml.safe_dump({**SCENARIO, "agents": agents, "specifications": stated}))

    def results(steps: int) -> list[list[Any]]:
        with prepared(build(tmp_path / "line.yaml"), None) as run:
            (monitor,) = run.specification_monitors
            found = []
            while run.status is None:
                run.advance(steps)
                found.append([each.tolist() for each in (monitor.verdicts, monitor.lower, monitor.upper)])
        return found

    # Both leave at 2 s, in the fourth step of 0.5 s; until the run ends, their results are the last ones before.
    assert results(1)[4::5] == results(5)
