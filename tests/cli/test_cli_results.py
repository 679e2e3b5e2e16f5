"""`--results`: each command that decides something writes test cases, also if it fails; its exit status stays."""

import json
from pathlib import Path

import junitparser
import pytest
from checkout import CHECKOUT
from typer.testing import CliRunner

from symaware_cli.cli.application import application

SHORTCUT = CHECKOUT / "scenarios" / "shortcut.yaml"


def invoke(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(application, list(map(str, words)))
    return done.exit_code, done.output


def cases(file: Path) -> dict[str, tuple[str, str, str | None]]:
    """The cases of a file by name: how each ended, why, and its line."""
    found = {}
    for suite in junitparser.JUnitXml.fromfile(str(file)):
        for case in suite:
            ended = [(type(each).__name__.lower(), each.type or each.message) for each in case.result]
            found[case.name] = (*(ended[0] if ended else ("passed", "")), case._elem.get("line"))
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a violated run, a short one, and a sweep with a claim."""
    made = tmp_path_factory.mktemp("results")
    run = ("run", SHORTCUT, "-q", "--set", "run.duration=7", "--output", made / "shortcut.mcap")
    assert invoke(*run, "--results", f"junit:{made / 'run.xml'}", "--results", f"sarif:{made / 'run.sarif'}") == (3, "")
    hello = CHECKOUT / "scenarios" / "hello.yaml"
    assert invoke("run", hello, "-q", "--set", "run.duration=0.2", "--output", made / "hello.mcap")[0] == 0
    sweep = ("sweep", SHORTCUT, "-o", made / "swept", "--set", "run.duration=0.2", "--runs", 2, "--jobs", 0, "-q")
    claim = ("--with", "claim=P(safe) > 0.1 with confidence 0.5", "--results", f"junit:{made / 'sweep.xml'}")
    assert invoke(*sweep, *claim)[0] == 0
    return made


def test_a_violated_specification_is_a_failure_at_its_line_of_the_scenario(folder: Path) -> None:
    found = cases(folder / "run.xml")
    assert found["run"][0] == "passed"
    assert found["safe"] == ("failure", "violated-specification", "8")
    assert found["fetch"][0] == "skipped"
    results = json.loads((folder / "run.sarif").read_text())["runs"][0]["results"]
    assert "violated-specification" in {each["ruleId"] for each in results}


def test_check_places_specifications_in_the_files_of_the_log(folder: Path) -> None:
    status, _ = invoke("check", folder / "shortcut.mcap", "--results", f"junit:{folder / 'check.xml'}")
    assert status == 3
    assert cases(folder / "check.xml")["safe"] == ("failure", "violated-specification", "8")


def test_a_run_that_fails_is_an_error_and_the_file_is_written(tmp_path: Path) -> None:
    (tmp_path / "wrong.py").write_text(
        "from symaware_cli import controller\n\n\n@controller\ndef steer(state, knowledge, time):\n    return [1 / 0]\n"
    )
    scenario = tmp_path / "wrong.yaml"
    scenario.write_text((CHECKOUT / "scenarios" / "hello.yaml").read_text())
    change = "agents.robot.components.steer={use: wrong.steer}"
    words = ("run", scenario, "-q", "--no-record", "--plugin", tmp_path / "wrong.py", "--set", change)
    status, _ = invoke(*words, "--results", f"junit:{tmp_path / 'r.xml'}")
    assert status == 1
    assert cases(tmp_path / "r.xml")["run"][:2] == ("error", "failed-run")


@pytest.mark.parametrize("verb", ["run", "validate"])
def test_problems_of_a_scenario_are_errors_with_their_codes(verb: str, tmp_path: Path) -> None:
    scenario = tmp_path / "broken.yaml"
    scenario.write_text((CHECKOUT / "scenarios" / "hello.yaml").read_text().replace("speed: 1.2", "sped: 1.2"))
    status, _ = invoke(verb, scenario, "--results", f"junit:{tmp_path / 'r.xml'}")
    assert status == 2
    assert cases(tmp_path / "r.xml") == {"agents.robot.components.steer.with.sped": ("error", "unknown-key", "19")}


def test_a_log_that_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "no.mcap").write_bytes(b"nothing")
    status, _ = invoke("check", tmp_path / "no.mcap", "--results", f"junit:{tmp_path / 'r.xml'}")
    assert status == 2
    assert cases(tmp_path / "r.xml")["check"][:2] == ("error", "invalid-input")


def test_each_row_of_a_sweep_is_a_case_and_so_is_the_claim(folder: Path) -> None:
    assert cases(folder / "sweep.xml") == {"run 0": ("passed", "", None), "run 1": ("passed", "", None)}
    assert invoke("certify", folder / "swept", "--results", f"junit:{folder / 'claim.xml'}")[0] == 0
    ((name, found),) = cases(folder / "claim.xml").items()
    assert name.startswith("P(safe) > 0.1")
    assert found[0] == "passed"


def test_a_claim_that_is_not_established_is_a_failure(folder: Path) -> None:
    words = ("certify", folder / "swept", "--claim", "P(safe) > 0.99")
    assert invoke(*words, "--results", f"junit:{folder / 'claim.xml'}")[0] == 3
    (found,) = cases(folder / "claim.xml").values()
    assert found[:2] == ("failure", "post-hoc-claim")


def test_a_repetition_and_a_sound_sweep_are_cases_that_pass(folder: Path) -> None:
    assert invoke("verify", folder / "hello.mcap", "-q", "--results", f"junit:{folder / 'v.xml'}")[0] == 0
    assert cases(folder / "v.xml") == {"messages": ("passed", "", None)}
    words = ("verify", folder / "swept", "--level", "arithmetic", "-q")
    assert invoke(*words, "--results", f"junit:{folder / 'w.xml'}")[0] == 0
    assert cases(folder / "w.xml") == {"sound": ("passed", "", None)}


def test_each_channel_that_is_compared_is_a_case(folder: Path) -> None:
    other, change = folder / "other.mcap", "agents.robot.components.steer.with.speed=1.2000001"
    hello = CHECKOUT / "scenarios" / "hello.yaml"
    assert invoke("run", hello, "-q", "--set", "run.duration=0.2", "--set", change, "--output", other)[0] == 0
    assert invoke("diff", folder / "hello.mcap", other, "--results", f"junit:{folder / 'd.xml'}")[0] == 1
    found = cases(folder / "d.xml")
    assert found["/agents/robot/control"][:2] == ("failure", "difference")
    assert found["/contacts"][0] == "passed"
    assert found["agents.robot.components.steer.with.speed"][0] == "failure"


def test_within_tolerances_only_the_scenario_is_different(folder: Path, tmp_path: Path) -> None:
    other, change = tmp_path / "other.mcap", "agents.robot.components.steer.with.speed=1.2000001"
    hello = CHECKOUT / "scenarios" / "hello.yaml"
    assert invoke("run", hello, "-q", "--set", "run.duration=0.2", "--set", change, "--output", other)[0] == 0
    tolerance = tmp_path / "t.yaml"
    tolerance.write_text('symaware-tolerance: 1\nchannels: {"*": {absolute: 1.0e-5}, resolved.yaml: {}}\n')
    status, out = invoke("diff", folder / "hello.mcap", other, "--tolerance", tolerance, "--json")
    assert status == 1
    found = json.loads(out)
    assert found["channels"] == []
    assert [each["topic"] for each in found["attachments"]] == ["resolved.yaml"]
    tolerance.write_text('symaware-tolerance: 1\nchannels: {"*": {absolute: 1.0e-8}}\n')
    found = json.loads(invoke("diff", folder / "hello.mcap", other, "--tolerance", tolerance, "--json")[1])
    assert "/agents/robot/control" in [each["topic"] for each in found["channels"]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("junti:a.xml", "did you mean `junit`?"),
        ("a.xml", "takes FORMAT:FILE"),
        ("junit:none/a.xml", "there is no folder"),
    ],
)
def test_a_wrong_option_is_refused_before_anything_runs(text: str, said: str, tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    status, out = invoke("run", CHECKOUT / "scenarios" / "hello.yaml", "--output", log, "--results", text)
    assert status == 2
    assert said in out
    assert not log.exists()


def test_several_scenarios_are_validated_at_once(tmp_path: Path) -> None:
    broken = tmp_path / "broken.yaml"
    broken.write_text("symaware: 1\n")
    hello = CHECKOUT / "scenarios" / "hello.yaml"
    status, out = invoke("validate", hello, broken)
    assert status == 2
    assert f"{hello}: sound" in out
    assert f"{broken}:1:1" in out
    found = json.loads(invoke("validate", hello, SHORTCUT, "--json")[1])
    assert [each["name"] for each in found["scenarios"]] == ["hello", "shortcut"]
