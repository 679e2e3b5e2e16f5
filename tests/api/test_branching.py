"""A branch is the same run up to an instant, and another one from there on; its log is a log like any other."""

import os
import random
from pathlib import Path

import pytest

from symaware_cli import BranchError, branch, compare, open_log, verify_log
from symaware_cli.recording.digest import digest
from symaware_cli.recording.error import LogError
from symaware_cli.scenario.build import build
from symaware_cli.scenario.execution import execute
from symaware_cli.scenario.problem import ScenarioError

FOLDER = Path(__file__).parents[2] / "scenarios"
SCENARIOS = sorted(
    path for path in FOLDER.rglob("*") if path.suffix in (".yaml", ".toml") and not path.name.startswith("_")
)

#: How many random pairs of a scenario and an instant are tried.
PAIRS = int(os.environ.get("SYMAWARE_BRANCHES", "5"))

SPEED = "agents.robot.components.steer.with.speed=0.5"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "hello.mcap"
    execute(build(FOLDER / "hello.yaml", ["run.duration=6"]), path)
    return path


def test_a_branch_without_a_change_has_the_digest_of_the_log(log: Path, tmp_path: Path) -> None:
    result = branch(log, 2.0, output=tmp_path / "same.mcap")
    assert not digest(open_log(log)).differences(digest(open_log(tmp_path / "same.mcap")))
    assert result.equal > 0
    assert not result.changes


@pytest.mark.parametrize(
    ("change", "topic"),
    [
        (SPEED, "/agents/robot/control"),
        ("agents.robot.2.state=[0, 0, 0]", "/world/robot/state"),
        ("agents.robot.0.knowledge.goal=[1, 1]", "/agents/robot/knowledge"),
        ("faults.dead.stop=robot.1", "/agents/robot/control"),
        ("agents.robot.components.steer.use=control.velocity-obstacle", "/agents/robot/control"),
        ("agents.robot.1.components.steer={use: control.mpc, with: {horizon: 2.0}}", "/agents/robot/control"),
    ],
)
def test_a_changed_branch_is_equal_before_its_instant_and_repeats(
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


def test_an_instant_can_be_that_of_an_event_with_a_shift(log: Path) -> None:
    touched = next(event.time for event in open_log(log).events() if event.name == "contact")
    assert branch(log, "contact(environment) - 1.5").at == touched / 1e9 - 1.5


@pytest.mark.parametrize(
    ("at", "change", "said"),
    [
        (7.0, SPEED, "not within the run"),
        ("violated(safe)", SPEED, "no event violated"),
        ("soon", SPEED, "is no instant"),
        (2.0, "agents.robot.count=3", "cannot change at an instant"),
        (2.0, "environment.with.time_step=0.1", "cannot change at an instant"),
        (2.0, "agents.robot.components.steer=null", "cannot change at an instant"),
        (2.0, "agents.robot.components.steer={use: control.mpc, period: 0.1}", "cannot change at an instant"),
        (2.0, "faults.early={at: 1.0, stop: robot.1}", "affects the run before"),
    ],
)
def test_a_branch_that_cannot_be_is_refused(at: float | str, change: str, said: str, log: Path, tmp_path: Path) -> None:
    with pytest.raises(BranchError, match=said):
        branch(log, at, [change], tmp_path / "none.mcap")
    assert not (tmp_path / "none.mcap").exists()


def test_another_component_has_its_own_parameters_alone_and_is_replaced_again_in_a_branch_of_the_branch(
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


def test_a_wrong_parameter_is_a_problem_of_the_scenario(log: Path) -> None:
    with pytest.raises(ScenarioError, match="sped"):
        branch(log, 2.0, ["agents.robot.components.steer.with.sped=0.5"])


def test_the_log_itself_is_not_replaced(log: Path) -> None:
    with pytest.raises(LogError, match="needs another file"):
        branch(log, 2.0, [SPEED], log)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(PAIRS))
def test_random_scenarios_branch_at_random_instants(seed: int, tmp_path: Path) -> None:
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
