"""The verb `branch`: its report, its files and its exit status."""

import csv
import json
from pathlib import Path

from checkout import CHECKOUT
from typer.testing import CliRunner

from symaware_cli.cli.application import application
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

SCENARIOS = CHECKOUT / "scenarios"
SPEED = "agents.robot.components.steer.with.speed"


def test_several_branches_of_a_run_are_reported_with_their_verdicts(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    execute(
        build(
            SCENARIOS / "hello.yaml",
            ["run.duration=5", "specifications.apart={each: robot, formula: 'always nearest > 1.0'}"],
        ),
        log,
    )
    folder = tmp_path / "branches"
    arguments = ["branch", str(log), "--at", "violated(apart) - 3", "--over", f"{SPEED}=0.4,1.2", "-o", str(folder)]
    shown = CliRunner().invoke(application, [*arguments, "--json"])
    results = json.loads(shown.stdout)
    assert [Path(each["run"]["log"]).name for each in results] == ["0.mcap", "1.mcap"]
    assert shown.exit_code == 3, "the faster one violates it"
    verdicts = [each["run"]["specifications"][0]["verdict"] for each in results]
    assert verdicts == ["satisfied", "violated"]
    assert [each["way"] for each in results] == ["capture", "capture"]
    told = CliRunner().invoke(application, arguments).stdout.splitlines()
    assert "2 of 2 continue from the state of one run to the instant" in told[2]
    assert told[3].split()[:5] == ["branch", "speed", "status", "apart", "apart"]
    assert [line.split()[:4] for line in told[4:6]] == [
        ["0", "0.4", "finished", "satisfied"],
        ["1", "1.2", "finished", "violated"],
    ]
    with (folder / "branches.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["apart"] for row in rows] == verdicts
    robustness = [float(row["apart robustness"]) for row in rows]
    assert robustness == [each["run"]["specifications"][0]["robustness"] for each in results]
    closest = [float(row["closest"]) for row in rows]
    assert closest == [each["run"]["minimum_separation"]["value"] for each in results]


def test_a_wrong_option_is_explained(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    execute(build(SCENARIOS / "hello.yaml", ["run.duration=1"]), log)
    for option in ("run.duration", f"{SPEED}=1..0 by 0.1", f"{SPEED}=[1"):
        shown = CliRunner().invoke(application, ["branch", str(log), "--at", "0.5", "--over", option])
        assert shown.exit_code == 2
        assert "--over" in shown.output
