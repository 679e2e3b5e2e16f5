"""A branch is the same run up to an instant and a different one afterwards; its log is a log like any other."""

import os
import random
from collections.abc import Sequence
from pathlib import Path

import pytest
from checkout import CHECKOUT

from symaware_cli import BranchError, branch, branches, compare, open_log, verify_log
from symaware_cli.core.stateful import StateError
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError
from symaware_cli.log.digest import digest
from symaware_cli.log.error import LogError

FOLDER = CHECKOUT / "scenarios"
SCENARIOS = sorted(
    path for path in FOLDER.rglob("*") if path.suffix in (".yaml", ".toml") and not path.name.startswith("_")
)

#: The number of random pairs of a scenario and an instant to try.
PAIRS = int(os.environ.get("SYMAWARE_BRANCHES", "5"))

SPEED = "agents.robot.components.steer.with.speed=0.5"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "head-on.mcap"
    execute(build(FOLDER / "head-on.yaml", ["run.duration=6"]), path)
    return path


def test_a_branch_without_changes_has_the_digest_of_the_log(log: Path, tmp_path: Path) -> None:
    result = branch(log, 2.0, output=tmp_path / "same.mcap")
    assert not digest(open_log(log)).differences(digest(open_log(tmp_path / "same.mcap")))
    assert result.equal > 0
    assert not result.changes


@pytest.mark.parametrize(
    ("change", "topic"),
    [
        (SPEED, "/agents/robot/control"),
        ("agents.robot[2].state=[0, 0, 0]", "/world/robot/state"),
        ("agents.robot[0].knowledge.goal=[1, 1]", "/agents/robot/knowledge"),
        ("faults.dead.stop=robot.1", "/agents/robot/control"),
        ("agents.robot.components.steer.use=control.velocity-obstacle", "/agents/robot/control"),
        ("agents.robot[1].components.steer={use: control.mpc, with: {horizon: 2.0}}", "/agents/robot/control"),
    ],
)
def test_a_changed_branch_is_equal_before_its_instant_and_reproducible(
    change: str, topic: str, log: Path, tmp_path: Path
) -> None:
    made = tmp_path / "other.mcap"
    result = branch(log, 2.0, [change], made)
    compared = compare(log, made)
    assert [each.path.partition(".")[0] for each in compared.scenario] == ["faults"]
    assert compared.first is not None
    assert compared.first.time == 2_000_000_000
    assert topic in [each.topic for each in compared.channels]
    assert result.equal == sum(
        each.time < 2_000_000_000 and each.channel.topic != "/timing" for each in open_log(log).messages()
    )
    assert verify_log(made).is_equal
    again = branch(made, 4.0, ["faults.later.stop=robot.3"], tmp_path / "again.mcap")
    assert again.equal > result.equal


def test_an_instant_can_be_an_event_with_a_shift(log: Path) -> None:
    touched = next(event.time for event in open_log(log).events() if event.name == "contact")
    assert branch(log, "contact(environment) - 1.5").at == touched / 1e9 - 1.5


@pytest.mark.parametrize(
    ("at", "change", "said"),
    [
        (7.0, SPEED, "not within the run"),
        ("violated(safe)", SPEED, "no event is called violated"),
        ("soon", SPEED, "is no instant"),
        (2.0, "agents.robot.count=3", "cannot change at an instant"),
        (2.0, "environment.with.time_step=0.1", "cannot change at an instant"),
        (2.0, "agents.robot.components.steer=null", "cannot change at an instant"),
        (2.0, "agents.robot.components.steer={use: control.mpc, period: 0.1}", "cannot change at an instant"),
        (2.0, "faults.early={at: 1.0, stop: robot.1}", "affects the run before"),
    ],
)
def test_impossible_branches_are_rejected(at: float | str, change: str, said: str, log: Path, tmp_path: Path) -> None:
    with pytest.raises(BranchError, match=said):
        branch(log, at, [change], tmp_path / "none.mcap")
    assert not (tmp_path / "none.mcap").exists()


def test_a_replacement_has_only_its_own_parameters_and_can_be_replaced_in_a_further_branch(
    log: Path, tmp_path: Path
) -> None:
    steer = "agents.robot.components.steer"
    changes = {f"{steer}.with.speed": 0.7, f"{steer}.use": "control.velocity-obstacle"}
    result = branch(log, 2.0, changes, tmp_path / "one.mcap")
    use = '{"of": "robot.steer", "use": "control.velocity-obstacle", "with": {"speed": 0.7}}'
    assert result.changes == (f'faults.branch-1={{"at": 2.0, "replace": {use}}}',)
    assert verify_log(tmp_path / "one.mcap").is_equal
    with pytest.raises(ScenarioError, match="is replaced by the fault `branch-1`"):
        branch(tmp_path / "one.mcap", 4.0, {f"{steer}.with.speed": 0.2})
    again = branch(tmp_path / "one.mcap", 4.0, {f"{steer}.use": "control.mpc"}, tmp_path / "two.mcap")
    assert again.equal > result.equal
    assert verify_log(tmp_path / "two.mcap").is_equal


def test_an_invalid_parameter_is_a_problem_of_the_scenario(log: Path) -> None:
    with pytest.raises(ScenarioError, match="sped"):
        branch(log, 2.0, ["agents.robot.components.steer.with.sped=0.5"])


def test_a_branch_cannot_overwrite_its_log(log: Path) -> None:
    with pytest.raises(LogError, match="needs another file"):
        branch(log, 2.0, [SPEED], log)


def assert_both_ways_are_equal(run: Path, at: float, changes: Sequence[Sequence[str]], folder: Path) -> list[str]:
    """Create branches from a captured state and by repetition; return the reasons where capture is impossible."""
    made = branches(run, at, changes, folder / "one", way=None)
    again = branches(run, at, changes, folder / "other", way="repetition")
    for one, other in zip(made, again, strict=True):
        assert other.way == "repetition"
        assert (one.way == "capture") == (not one.reason)
        assert one.equal == other.equal
        assert one.summary.log is not None
        assert other.summary.log is not None
        assert not digest(open_log(one.summary.log)).differences(digest(open_log(other.summary.log)))
        figures = [
            {**each.summary.to_json(), "log": None, "log_size": None, "wall_time": None, "real_time_factor": None}
            for each in (one, other)
        ]
        assert figures[0] == figures[1]
    return [each.reason for each in made]


@pytest.mark.parametrize(
    ("scenario", "at"),
    [
        ("head-on.yaml", 0.73),
        ("head-on.yaml", 1.0),
        ("asynchronous.yaml", 1.234),
        ("crossing.yaml", 1.5),
        ("noisy.yaml", 0.51),
        ("rumour.yaml", 1.1),
        ("rendezvous.toml", 1.0),
        ("convoy.yaml", 0.9),
    ],
)
@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_branches_from_a_captured_state_equal_those_by_repetition(
    scenario: str, at: float, mode: str, tmp_path: Path
) -> None:
    run = tmp_path / "run.mcap"
    execute(build(FOLDER / scenario, ["run.duration=1.6", f"run.mode={mode}"]), run)
    group, agents = next(iter(open_log(run).agents.items()))
    changes = [
        [],
        [f"faults.dead.stop={agents[0]}"],
        [f"faults.deaf={{for: 0.2, drop: {{receiver: {agents[-1]}, probability: 0.5}}}}"],
        [f"faults.late={{at: {at + 0.2}, delay: {{sender: {group}, by: 0.1}}}}", f"faults.dead.stop={agents[-1]}"],
    ]
    assert assert_both_ways_are_equal(run, at, changes, tmp_path) == [""] * 4


def test_every_kind_of_change_works_with_capture_and_repetition(log: Path, tmp_path: Path) -> None:
    speed = "agents.robot.components.steer.with.speed"
    kinds = [
        [f"{speed}=0.4"],
        [f"{speed}=1.1"],
        ["agents.robot[2].state=[0, 0, 0]"],
        ["agents.robot[0].knowledge.goal=[1, 1]", f"{speed}=0.6"],
    ]
    assert assert_both_ways_are_equal(log, 2.0, kinds, tmp_path) == [""] * 4


def test_a_branch_that_cannot_use_the_captured_state_is_repeated_with_a_reason(log: Path, tmp_path: Path) -> None:
    changes = [
        ["run.duration=7"],
        ["agents.robot.components.steer.use=control.velocity-obstacle"],
        ["faults.dead={on: {event: contact}, stop: robot.1}"],
        ["faults.dead.stop=robot.1"],
    ]
    reasons = assert_both_ways_are_equal(log, 2.0, changes, tmp_path)
    assert "`run.duration` acts from the beginning" in reasons[0]
    assert "another component" in reasons[1]
    assert "`dead` may begin earlier" in reasons[2]
    assert not reasons[3]
    with pytest.raises(StateError, match="another component"):
        branches(log, 2.0, changes[1:2], way="capture")


def test_a_branch_is_repeated_if_a_fault_of_the_log_ends_as_another_begins(tmp_path: Path) -> None:
    run = tmp_path / "run.mcap"
    fault = "faults.still={at: 0.5, for: 0.5, freeze: robot.steer}"
    execute(build(FOLDER / "head-on.yaml", ["run.duration=2", fault]), run)
    changes = [["faults.dead.stop=robot.1"], ["faults.dead.stop=robot.2"]]
    assert all("may end as `dead` begins" in each for each in assert_both_ways_are_equal(run, 1.0, changes, tmp_path))
    (tmp_path / "later").mkdir()
    assert assert_both_ways_are_equal(run, 0.8, changes, tmp_path / "later") == ["", ""]


def test_branches_of_a_world_without_capture_are_repeated(tmp_path: Path) -> None:
    run = tmp_path / "run.mcap"
    execute(build(FOLDER / "billiards.yaml", ["run.duration=1"]), run)
    agent = next(iter(open_log(run).agents.values()))[0]
    reasons = assert_both_ways_are_equal(run, 0.5, [[], [f"faults.dead.stop={agent}"]], tmp_path)
    assert all("does not expose all of its state" in each for each in reasons)


def test_a_branch_from_a_state_can_be_verified_and_branched_again(log: Path, tmp_path: Path) -> None:
    branches(log, 2.0, [[SPEED]], tmp_path, way="capture")
    assert verify_log(tmp_path / "0.mcap").is_equal
    (again,) = branches(tmp_path / "0.mcap", 4.0, [["faults.later.stop=robot.3"]], tmp_path / "on", way="capture")
    assert verify_log(Path(again.summary.log or "")).is_equal


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(PAIRS))
def test_random_scenarios_can_branch_at_random_instants(seed: int, tmp_path: Path) -> None:
    draw = random.Random(seed)
    scenario = draw.choice(SCENARIOS)
    execute(build(scenario, ["run.duration=2"]), tmp_path / "run.mcap")
    log = open_log(tmp_path / "run.mcap")
    at = draw.uniform(0.0, (log.end_time or 0) / 1e9)
    branch(tmp_path / "run.mcap", at, output=tmp_path / "same.mcap")
    assert not digest(log).differences(digest(open_log(tmp_path / "same.mcap")))
    agent = next(iter(log.agents.values()))[0]
    branch(tmp_path / "run.mcap", at, [f"faults.dead.stop={agent}"], tmp_path / "other.mcap")
    first = compare(tmp_path / "run.mcap", tmp_path / "other.mcap").first
    assert first is None or first.time is None or first.time >= int(at * 1e9)
    assert_both_ways_are_equal(tmp_path / "run.mcap", at, [[], [f"faults.dead.stop={agent}"]], tmp_path)
