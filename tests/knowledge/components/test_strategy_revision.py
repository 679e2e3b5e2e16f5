import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT

from symaware_cli import RunFailedError, ScenarioError, SimulationState, load, open_log
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.knowledge.components import blocked_cells, strategy_revision
from symaware_cli.knowledge.synthesis.game import Game
from symaware_cli.knowledge.synthesis.strategy import Strategy
from symaware_cli.knowledge.synthesis.strategy_process import StrategyProcess
from symaware_cli.log.digest import digest

SCENARIOS = CHECKOUT / "scenarios"
REVISION = "agents.{}.components.decide.with.revision"
ASYNCHRONOUS = {
    "run.mode": "asynchronous",
    "agents.scout.components.decide.period": 0.1,
    "agents.scout.components.decide.run_in": "process",
}


#: A signal closes the way out of an aisle while the robot is in it, which is assumed not to happen, and opens it again.
JAM = """
symaware: 1
name: jam
run: {duration: 20.0}
environment: {use: kinematic, with: {time_step: 0.1}}
regions:
  arena: {box: [0, 5, 0, 1]}
  home: {box: [0, 1, 0, 1]}
  narrow: {box: [2, 5, 0, 1]}
  near: {box: [1, 5, 0, 1]}
  end: {box: [4, 5, 0, 1]}
  jammed: {box: [0, 9, 3, 9]}
knowledge_models:
  aisle: {use: abstraction.grid, with: {cell: 1.0, region: arena}}
agents:
  signal:
    model: {use: single-integrator, with: {max_speed: 1.0}}
    state: [0.5, 2.3]
    knowledge: {waypoints: {all: [[0.5, 3.8], [0.5, 2.0]]}}
    components:
      sense: {use: perception.self}
      slide: {use: control.waypoints, with: {speed: 0.2}}
  robot:
    model: {use: single-integrator, with: {max_speed: 1.0}}
    state: [0.5, 0.5]
    components:
      sense: {use: perception.omniscient}
      decide:
        use: knowledge.strategy
        with:
          model: aisle
          labels: {jam: {agent: signal, inside: jammed}}
          assumptions: ["always (not jam and near implies not next jam)"]
          guarantees:
            - always (jam and narrow implies next narrow)
            - always eventually home
            - always eventually (end or jam)
          on_violation: last-safe-cell
      steer: {use: control.cells, with: {model: aisle}}
"""


def run(log: Path, changes: Mapping[str, Any] | None = None, name: str = "blocked.yaml") -> Path:
    assert load(SCENARIOS / name, changes).run(output=log).status == "finished"
    return log


def events(log: Path, source: str, *names: str) -> list[tuple[float, str]]:
    found = open_log(log).events()
    return [(each.time / 1e9, each.name) for each in found if each.source == f"agents.{source}" and each.name in names]


def cells(log: Path, agent: str) -> set[tuple[int, int]]:
    """The cells of side 1 that a path passes, without those that it only touches."""
    points = open_log(log).series(agent, "state").values[:, :2]
    inner = points[(np.abs(points - np.round(points)) > 1e-5).all(axis=1)]
    return {tuple(each) for each in np.floor(inner).astype(int).tolist()}


def test_a_blocked_passage_that_one_robot_sees_is_avoided_by_both(tmp_path: Path) -> None:
    log = run(tmp_path / "a.mcap")
    assert len(events(log, "scout.learn", "cell-seen")) == 2
    assert len(events(log, "carrier.learn", "cell-told")) == 2
    assert not events(log, "carrier.learn", "cell-seen")
    for robot in ("scout", "carrier"):
        assert not {(3, 3), (3, 4)} & cells(log, robot)
        assert len(events(log, f"{robot}.decide", "goal-met")) >= 2
        (learnt, _), (revised, _) = events(log, f"{robot}.decide", "cells-learnt", "strategy-revised")
        assert revised == pytest.approx(learnt + 0.5)


def test_poses_that_a_late_scan_needs_are_kept_when_older_ones_are_dropped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    changes = {"agents.scout.components.lidar.latency": 0.5, "run.duration": 20.0}
    whole = events(run(tmp_path / "a.mcap", changes), "scout.learn", "cell-seen")
    assert whole
    monkeypatch.setattr(blocked_cells, "_MOST_POSES", 6)  # a scan is read 0.5 to 0.7 s after it was taken
    assert events(run(tmp_path / "b.mcap", changes), "scout.learn", "cell-seen") == whole


def test_without_a_crate_nothing_is_learnt_and_the_gap_is_the_way(tmp_path: Path) -> None:
    changes = {"environment.entities.crate.position": [0.5, 7.0], "run.duration": 20.0}
    log = run(tmp_path / "a.mcap", changes)
    assert not events(log, "scout.learn", "cell-seen")
    assert (3, 3) in cells(log, "scout")


def test_a_robot_that_receives_a_message_under_way_turns_back(tmp_path: Path) -> None:
    changes = {"agents.scout.components.lidar.with.range": 0.65, "environment.entities.crate.shape.box.length": 0.4}
    log = run(tmp_path / "a.mcap", {**changes, "run.duration": 20.0})
    assert [name for _, name in events(log, "scout.decide", "turned-back")] == ["turned-back"]
    assert len(events(log, "scout.decide", "goal-met")) >= 1


def informed(*told: tuple[float, list[str]]) -> dict[str, Any]:
    """Changes by which the carrier does not hear from the scout but is told at instants [s] which cells are blocked."""
    faults = {
        f"news_{number}": {"at": at, "inform": {"of": "carrier", "knowledge": {"blocked": {"all": cells}}}}
        for number, (at, cells) in enumerate(told)
    }
    return {"agents.scout.components.tell": None, "faults": faults, "run.duration": 4.0}


def test_a_list_may_shrink_and_the_strategy_depends_on_the_list_alone(tmp_path: Path) -> None:
    log = run(tmp_path / "a.mcap", informed((1.0, ["c3_4"]), (2.0, [])))
    told = [each for each in open_log(log).events() if each.source == "agents.carrier.decide"]
    (made,) = [each.data["digest"] for each in told if each.name == "strategy-made"]
    revised = {each.time / 1e9: each.data["digest"] for each in told if each.name == "strategy-revised"}
    assert list(revised) == pytest.approx([1.5, 2.5])
    without, again = revised.values()
    assert again == made != without


def test_a_cell_that_does_not_exist_fails_the_component_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(
        RunFailedError, match=r"carrier.decide .* at 1 s: .* lists 'c3_44', which is no cell of `floor`"
    ):
        load(SCENARIOS / "blocked.yaml", informed((1.0, ["c3_44"]))).run(output=tmp_path / "a.mcap")


@pytest.mark.parametrize(
    ("changes", "reported"),
    [
        ({REVISION.format("scout") + ".budget": 100}, "budget-exceeded"),
        ({"regions.south.box": [0, 10, 3, 4]}, "strategy-unrealisable"),  # the way round is forbidden
    ],
)
def test_a_robot_without_a_new_strategy_says_so_and_stays(
    changes: Mapping[str, Any], reported: str, tmp_path: Path
) -> None:
    log = run(tmp_path / "a.mcap", {**changes, "run.duration": 15.0})
    names = [name for _, name in events(log, "scout.decide", "budget-exceeded", "strategy-unrealisable", "goal-met")]
    assert names == [*(["budget-exceeded"] if reported == "budget-exceeded" else []), "strategy-unrealisable"]
    assert not {(3, 3), (3, 4)} & cells(log, "scout")


def test_strategies_made_here_and_in_a_process_give_equal_logs(tmp_path: Path) -> None:
    changes = {**ASYNCHRONOUS, "run.duration": 8.0}
    apart = digest(open_log(run(tmp_path / "apart.mcap", changes)))
    once_more = {**changes, "agents.scout.components.decide.run_in": "here"}
    within = digest(open_log(run(tmp_path / "within.mcap", once_more)))
    assert within.channels == apart.channels
    (landed, _) = events(tmp_path / "apart.mcap", "scout.decide", "strategy-revised")[0]
    (learnt, _) = events(tmp_path / "apart.mcap", "scout.decide", "cells-learnt")[0]
    assert landed == pytest.approx(learnt + 0.5)


def test_a_run_goes_on_from_its_state_after_a_strategy_was_made_again(tmp_path: Path) -> None:
    changes = {"run.duration": 10.0}
    scenario, ends = load(SCENARIOS / "blocked.yaml", changes), []
    with scenario.start() as whole:
        whole.step(50)
        state = whole.capture()
        for _ in range(2):
            whole.step(40)
            ends.append((whole.state("scout"), whole.state("carrier")))
            whole.restore(state)
    with scenario.start() as other:
        other.restore(SimulationState.from_bytes(state.to_bytes()))
        other.step(40)
        ends.append((other.state("scout"), other.state("carrier")))
    assert all(np.array_equal(one, ends[0]) for one in ends[1:])


def test_the_order_of_hashes_changes_nothing(tmp_path: Path) -> None:
    found = set()
    for seed in ("1", "2"):
        log = tmp_path / f"{seed}.mcap"
        command = ["run", str(SCENARIOS / "blocked.yaml"), "--set", "run.duration=4.0", "--output", str(log)]
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        subprocess.run([sys.executable, "-m", "symaware_cli", *command], env=environment, check=True)
        found.add(digest(open_log(log)).combined)
        assert events(log, "carrier.decide", "strategy-revised")
    assert len(found) == 1


@pytest.mark.parametrize(
    ("fallback", "reported", "column"),
    [
        ("stop", [], 4),
        ("last-safe-cell", ["retreated", "retreated"], 2),  # the next move back would be out of the aisle
        ("resume", ["strategy-resumed"], None),  # when the way is open again
        ("weaken", ["assumption-dropped", "strategy-revised", "strategy-unrealisable"], 4),
    ],
)
def test_after_a_broken_assumption_an_agent_does_what_is_declared(
    fallback: str, reported: list[str], column: int | None, tmp_path: Path
) -> None:
    log = tmp_path / "jam.mcap"
    changes = {"agents.robot.components.decide.with.on_violation": fallback}
    (tmp_path / "jam.yaml").write_text(JAM)
    assert load(tmp_path / "jam.yaml", changes).run(output=log).status == "finished"
    told = [each.name for each in open_log(log).events() if each.source == "agents.robot.decide"]
    assert told[:3] == ["strategy-made", "goal-met", "assumption-broken"]
    assert [each for each in told[3:] if each != "goal-met"] == reported
    assert told.count("goal-met") == (1 if column is not None else 4)
    if column is not None:
        assert open_log(log).series("robot", "state").values[-1].tolist() == pytest.approx([column + 0.5, 0.5])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"agents.scout.knowledge": {"other": 1}}, "scout does not know `blocked`"),
        ({"agents.scout.knowledge.blocked": {"all": ["c9_9"]}}, "lists 'c9_9', which is no cell of `floor`"),
        ({"agents.scout.knowledge.blocked": 3}, "is 3, and no list of cells"),
        ({"agents.scout.components.decide.with.blocked": None}, "no strategy is made again without"),
        (
            {"agents.scout.components.decide.with.on_unrealisable": "counterstrategy"},
            "needs the strategy as it was made before",
        ),
        ({"agents.scout.components.learn.with.margin": 0.5}, "no ray can end so far from the border"),
        ({"agents.scout.components.learn.with.model": "flor"}, "no knowledge model `flor`"),
        ({REVISION.format("scout") + ".budget": 0}, "greater than 0"),
        ({REVISION.format("scout") + ".latency": -1}, "at least 0|greater than or equal to 0|not be less"),
    ],
)
def test_parameters_that_make_no_sense_are_refused(changes: Mapping[str, Any], said: str) -> None:
    with pytest.raises(ScenarioError, match=said):
        load(SCENARIOS / "blocked.yaml", changes)


DECIDE = "agents.robot.components.decide.with"
OVERDUE = ("assumption-overdue", "assumption-dropped", "assumption-kept", "strategy-resumed", "strategy-revised")


def test_an_overdue_assumption_is_dropped_and_the_other_door_taken(tmp_path: Path) -> None:
    log = run(tmp_path / "a.mcap", name="two-doors.yaml")
    assert events(log, "robot.decide", *OVERDUE) == [
        (14.5, "assumption-overdue"),
        (14.5, "assumption-dropped"),
        (15.0, "strategy-revised"),
    ]
    path = cells(log, "robot")
    assert (3, 0) in path
    assert (3, 4) not in path
    assert len(events(log, "robot.decide", "goal-met")) >= 4


def test_an_overdue_assumption_is_only_reported_unless_a_fallback_is_declared(tmp_path: Path) -> None:
    changes = {f"{DECIDE}.on_overdue": "report", f"{DECIDE}.revision": None}
    log = run(tmp_path / "a.mcap", changes, "two-doors.yaml")
    assert events(log, "robot.decide", *OVERDUE) == [(14.5, "assumption-overdue")]
    assert not cells(log, "robot") & {(3, 0), (3, 4)}


def test_without_what_is_overdue_there_may_be_no_strategy(tmp_path: Path) -> None:
    log = run(tmp_path / "a.mcap", {f"{DECIDE}.on_overdue": "weaken"}, "locked.yaml")
    found = [name for _, name in events(log, "robot.decide", *OVERDUE, "strategy-unrealisable")]
    assert found == ["assumption-overdue", "assumption-dropped", "strategy-revised", "strategy-unrealisable"]


#: The door opens after 20 s, long after it is overdue.
LATE = {
    "agents.door.knowledge.waypoints": {"all": [[3.5, 2.5], [3.5, 1.0], [3.5, 4.0]]},
    "agents.door.components.slide.with": {"speed": 0.2, "loop": False},
    f"{DECIDE}.patience": 5.0,
    "run.duration": 45.0,
}


@pytest.mark.parametrize(
    ("fallback", "passes"), [("report", True), ("stop", False), ("resume", True), ("last-safe-cell", False)]
)
def test_a_robot_stays_while_something_is_overdue_or_for_good(tmp_path: Path, fallback: str, passes: bool) -> None:
    log = run(tmp_path / "a.mcap", {**LATE, f"{DECIDE}.on_overdue": fallback}, "locked.yaml")
    found = [name for _, name in events(log, "robot.decide", *OVERDUE)]
    assert found[:2] == ["assumption-overdue", "assumption-kept"]
    assert ("strategy-resumed" in found) == (fallback == "resume")
    assert ((3, 2) in cells(log, "robot")) == passes


def test_while_something_is_overdue_a_robot_goes_back_to_the_last_cell_with_another_way(tmp_path: Path) -> None:
    # The robot comes from the southern door, which opens while it waits at the northern one. Only in the cell before
    # the southern door, while that is open, is there a strategy without the other: that door may close at any time.
    changes = {
        "agents.robot.state": [2.5, 0.5, 1.5],
        "agents.southern.components.slide.with.loop": False,
        f"{DECIDE}.assumptions": ["always eventually north_open"],
        f"{DECIDE}.guarantees": [
            "always (not north_open and not north implies not next north)",
            "always (not south_open and not south implies not next south)",
            "always eventually shelf",
        ],
        f"{DECIDE}.patience": 8.0,
        f"{DECIDE}.on_overdue": "last-safe-cell",
        f"{DECIDE}.revision": None,
        "run.duration": 25.0,
    }
    log = run(tmp_path / "a.mcap", changes, "two-doors.yaml")
    told = [each.text for each in open_log(log).events() if each.name == "retreated"]
    assert told == [f"goes back to c2_{row}" for row in (3, 2, 1, 0)]
    assert (2, 4) in cells(log, "robot")
    assert open_log(log).series("robot", "state").values[-1, :2].tolist() == pytest.approx([2.5, 0.5])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({f"{DECIDE}.patience": None, f"{DECIDE}.on_overdue": "stop"}, "nothing is ever overdue without a `patience`"),
        (
            {f"{DECIDE}.on_overdue": "weaken", f"{DECIDE}.on_unrealisable": "counterstrategy"},
            "leave `on_overdue: weaken` out",
        ),
    ],
)
def test_a_fallback_without_effect_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ScenarioError, match=said):
        load(SCENARIOS / "locked.yaml", changes)


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_a_process_makes_the_same_strategy_while_the_run_goes_on(
    tmp_path: Path, mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    noted: list[tuple[str, int]] = []
    steps = [0]

    class Noting(StrategyProcess):
        def __init__(self, game: Game, budget: int | None) -> None:
            noted.append(("begun", steps[0]))
            super().__init__(game, budget)

        def result(self) -> Strategy:
            noted.append(("due", steps[0]))
            return super().result()

    def counted(self: KinematicEnvironment) -> None:
        steps[0] += 1
        step(self)

    step = KinematicEnvironment.step
    monkeypatch.setattr(strategy_revision, "StrategyProcess", Noting)
    monkeypatch.setattr(KinematicEnvironment, "step", counted)
    here = run(tmp_path / "here.mcap", {"run.mode": mode}, "two-doors.yaml")
    assert not noted
    steps[0] = 0
    there = run(tmp_path / "there.mcap", {"run.mode": mode, f"{DECIDE}.revision.run_in": "process"}, "two-doors.yaml")
    assert noted == [("begun", 145), ("due", 150)]  # 0.5 s, the latency, apart
    one, two = digest(open_log(here)), digest(open_log(there))
    assert one.channels == two.channels


def test_a_process_that_would_take_more_than_the_budget_is_one_that_does_so_here(tmp_path: Path) -> None:
    changes = {f"{DECIDE}.revision.run_in": "process", f"{DECIDE}.revision.budget": 10, "run.duration": 20.0}
    log = run(tmp_path / "a.mcap", changes, "two-doors.yaml")
    assert [name for _, name in events(log, "robot.decide", "budget-exceeded")] == ["budget-exceeded"]


def test_a_process_without_a_latency_is_refused() -> None:
    with pytest.raises(ScenarioError, match="a process of its own needs a `latency`"):
        load(SCENARIOS / "two-doors.yaml", {f"{DECIDE}.revision": {"run_in": "process"}})
