"""A file beside a scenario: executed only if trusted, and then available wherever the scenario runs."""

import hashlib
import json
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest
from own_files import CONTROLLER, SCENARIO, written
from simulating import Command, in_process
from typer.testing import CliRunner, Result

import symaware_cli
from symaware_cli.cli.application import all_commands, application
from symaware_cli.log.digest import digest
from symaware_cli.plugin_files.file_trust import HANDED_DOWN

Verb = Callable[..., Result]

#: Notes that it was executed, wherever that happens.
HOSTILE = f"import pathlib\n(pathlib.Path({{marker!r}}) / 'executed').touch()\n{CONTROLLER}"


@pytest.fixture
def verb(home: Path) -> Verb:
    def run(*words: object) -> Result:
        return CliRunner().invoke(application, [*map(str, words)])

    return run


def test_an_untrusted_file_is_refused_at_its_place_with_the_remedy(home: Path, verb: Verb) -> None:
    written(home)
    done = verb("run", "own.yaml")
    assert done.exit_code == 2
    assert "own.yaml:3:11: `mine.py` is code, and it is not trusted" in done.stderr
    assert "symaware trust ." in done.stderr
    assert "--trust" in done.stderr
    assert "1 problem in" in done.stderr, "the names that it would define are no problem of their own"
    assert not list(home.glob("*.mcap"))


def test_from_an_empty_folder_to_a_run_of_an_own_controller(home: Path, verb: Verb) -> None:
    written(home)
    done = verb("run", "own.yaml", "--trust", "-q")
    assert done.exit_code == 0, done.output
    assert f"trusted mine.py, SHA-256 {hashlib.sha256(CONTROLLER.encode()).hexdigest()}" in done.stderr
    assert verb("run", "own.yaml", "-q", "-o", "again.mcap").exit_code == 0, "in the same process it stays trusted"
    assert digest(symaware_cli.open_log("own.mcap")).differences(digest(symaware_cli.open_log("again.mcap"))) == []


def test_a_folder_is_trusted_once_and_no_longer_after_an_edit(home: Path, command: Command) -> None:
    written(home)
    told = command("trust", ".")
    assert told.returncode == 0
    assert "mine.py" in told.stdout
    assert command("validate", "own.yaml").returncode == 0
    (home / "mine.py").write_text(f"{CONTROLLER}\n# edited\n")
    assert command("validate", "own.yaml").returncode == 2
    assert command("validate", "own.yaml", "--trust").returncode == 0
    assert command("validate", "own.yaml").returncode == 2, "for one command only"
    command("trust", ".")
    assert json.loads(command("trust", "--json").stdout) == json.loads(command("trust", ".", "--json").stdout)
    assert command("validate", "own.yaml").returncode == 0
    assert command("trust", "--forget", ".").returncode == 0
    assert command("validate", "own.yaml").returncode == 2


@pytest.mark.parametrize(
    ("controller", "told"),
    [
        ("def broken(:", "mine.py:1"),
        ("\n1 / 0", "`mine.py` cannot be imported: ZeroDivisionError: division by zero (mine.py, line 2)"),
        ("import no_such_module", "ModuleNotFoundError: No module named 'no_such_module' (mine.py, line 1)"),
        ("raise SystemExit(3)", "`mine.py` cannot be imported: SystemExit: 3 (mine.py, line 1)"),
        ("x = 1", "no component called `mine.Go` is installed"),
        (CONTROLLER.replace("_compute", "compute"), "does not implement _compute"),
        (CONTROLLER.replace("class Go", "class Gone"), "did you mean `mine.Gone`?"),
        (CONTROLLER.replace("(Controller)", ""), "no component called `mine.Go`"),
        (
            CONTROLLER.replace("class", "@symaware_cli.component('control.go-to-goal')\nclass").replace(
                "from", "import symaware_cli\nfrom", 1
            ),
            "the name `control.go-to-goal` is taken",
        ),
    ],
)
def test_an_unusable_file_is_reported_once_with_its_line(home: Path, verb: Verb, controller: str, told: str) -> None:
    written(home, controller)
    done = verb("validate", "own.yaml", "--trust")
    assert done.exit_code == 2
    said = " ".join(done.stderr.split())
    assert told in said or (told == "mine.py:1" and "`mine.py` is no valid Python" in said and "(line 1)" in said)
    assert "1 problem in" in done.stderr


def test_a_file_does_not_shadow_an_installed_family(home: Path, verb: Verb) -> None:
    written(home, scenario=SCENARIO.replace("mine", "control"))
    (home / "mine.py").rename("control.py")
    done = verb("validate", "own.yaml", "--trust")
    assert done.exit_code == 2
    assert "`control` is the family of installed plugins" in done.stderr


def test_a_name_of_an_unlisted_file_is_reported(home: Path, verb: Verb) -> None:
    written(home, scenario=SCENARIO.replace("plugins: [mine.py]\n", ""))
    done = verb("validate", "own.yaml")
    assert done.exit_code == 2
    assert "`plugins: [mine.py]` in the scenario" in done.stderr
    assert verb("validate", "own.yaml", "--plugin", "mine.py").exit_code == 0
    assert verb("run", "own.yaml", "-q", "--plugin", "mine.py").exit_code == 0
    assert verb("run", "own.mcap", "-q", "--plugin", "mine.py").exit_code == 2
    (home / "below").mkdir()
    (home / "below" / "own.yaml").write_bytes((home / "own.yaml").read_bytes())
    done = verb("run", "below/own.yaml", "-q", "--plugin", "mine.py")
    assert done.exit_code == 2
    assert "is not in the folder of below/own.yaml" in done.stderr


def test_the_option_for_one_file_does_not_trust_the_others(home: Path, verb: Verb) -> None:
    written(home)
    (home / "other.py").touch()
    assert verb("validate", "own.yaml", "--plugin", "other.py").exit_code == 2
    assert verb("validate", "own.yaml", "--plugin", "other.py", "--plugin", "mine.py").exit_code == 0


def test_lists_descriptions_and_schemas_have_the_plugins_of_a_file(home: Path, verb: Verb) -> None:
    written(home, f"{CONTROLLER}\n    class Parameters(Controller.Parameters):\n        gain: float = 2.0\n")
    assert "mine.Go" in verb("list", "components", "--plugin", "mine.py").stdout
    assert "gain" in verb("show", "mine.Go", "--plugin", "mine.py").stdout
    schema = json.loads(verb("schema", "--plugin", "mine.py").stdout)
    assert "gain" in schema["$defs"]["component:mine.Go"]["properties"]
    assert "mine.Go" not in verb("schema").stdout
    assert verb("show", "mine.Go").exit_code == 2


def test_a_base_and_an_override_name_files_and_do_not_trust_them(home: Path, verb: Verb) -> None:
    (home / "base").mkdir()
    written(home / "base")
    (home / "top.yaml").write_text("extends: base/own.yaml\nname: top\n")
    (home / "none.yaml").write_text(SCENARIO.replace("plugins: [mine.py]\n", ""))
    (home / "mine.py").write_text(CONTROLLER)
    assert verb("validate", "top.yaml").exit_code == 2
    assert verb("validate", "none.yaml", "--set", "plugins=[mine.py]").exit_code == 2
    assert verb("run", "top.yaml", "--trust", "-q").exit_code == 0
    assert "scenario/base/mine.py" in symaware_cli.open_log("top.mcap").attachments


def test_the_log_alone_repeats_the_run(home: Path, command: Command) -> None:
    path = written(home, f"import helper\n{CONTROLLER}")
    (home / "helper.py").write_text("x = 1")
    assert command("run", path, "--trust", "-q").returncode == 0
    for file in ("mine.py", "helper.py", "own.yaml"):
        (home / file).unlink()
    assert command("verify", "own.mcap").returncode == 2
    refused = command("run", "own.mcap", "-q")
    assert refused.returncode == 2
    assert "own.mcap:resolved.yaml" in refused.stderr
    verified = command("verify", "own.mcap", "--trust")
    assert verified.returncode == 0
    assert all(f"trusted {name}, SHA-256" in verified.stderr for name in ("mine.py", "helper.py"))
    again = command("run", "own.mcap", "--trust", "-q", "--set", "agents.robot.components.steer.run_in=process")
    assert again.returncode == 0, again.stderr
    names = sorted(name for name in symaware_cli.open_log("own-2.mcap").attachments if name.startswith("scenario/"))
    assert names == ["scenario/helper.py", "scenario/mine.py", "scenario/own.yaml"]


@pytest.mark.parametrize("place", ["here", "process"])
def test_a_run_that_fails_in_a_file_is_repeated_with_its_traceback(home: Path, verb: Verb, place: str) -> None:
    (home / "lib").mkdir()
    (home / "lib" / "helper.py").write_text("def fail():\n    raise ValueError('so')\n")
    failing = ["@controller", "def Go(state, knowledge, time):", "    helper.fail()"]
    imports = ["from symaware_cli import controller", "import helper"]
    scenario = SCENARIO.replace("mine.py", "lib/mine.py").replace("mine.Go", f"mine.Go, run_in: {place}")
    (home / "own.yaml").write_text(scenario)
    (home / "lib" / "mine.py").write_text("\n".join([*imports, *failing]))
    assert verb("run", "own.yaml", "--trust", "-q").exit_code == 1
    (failed,) = [event for event in symaware_cli.open_log("own.mcap").events() if event.name == "failed"]
    assert 'File "lib/helper.py", line 2, in fail' in failed.data["traceback"]
    assert "helper.fail()\n" in failed.data["traceback"]
    assert 'File "/' not in failed.data["traceback"]
    (home / "lib" / "mine.py").unlink()
    verified = verb("verify", "own.mcap", "--trust")
    assert verified.exit_code == 0, verified.output


def test_workers_sweeps_branches_and_states_have_the_plugins(home: Path, verb: Verb) -> None:
    written(home)
    assert verb("trust", ".").exit_code == 0
    process = ["--set", "agents.robot.components.steer.run_in=process"]
    assert verb("run", "own.yaml", "-q").exit_code == 0
    assert verb("run", "own.yaml", "-q", "-o", "process.mcap", *process).exit_code == 0
    states = [symaware_cli.open_log(name).series("robot.1", "world").values for name in ("own.mcap", "process.mcap")]
    assert np.array_equal(states[0], states[1])
    assert verb("sweep", "own.yaml", "--runs", "4", "-j", "2", "-o", "swept", "-q").exit_code == 0
    assert verb("verify", "swept").exit_code == 0
    assert (
        verb("branch", "own.mcap", "--at", "0.2", "--set", "agents.robot.knowledge.goal=[0, 0]", "-o", "b").exit_code
        == 0
    )
    assert verb("check", "own.mcap").exit_code == 0
    with symaware_cli.load("own.yaml").start() as simulation:
        simulation.step(4)
        state, ends = simulation.capture(), []
        for _ in range(2):
            simulation.restore(state)
            simulation.step(4)
            ends.append(simulation.state("robot.1").tolist())
        assert ends[0] == ends[1]


def test_an_edit_is_another_scenario_for_a_sweep_and_for_other_processes(home: Path, verb: Verb) -> None:
    written(home)
    verb("trust", ".")
    first = symaware_cli.load("own.yaml").outline
    assert verb("sweep", "own.yaml", "--runs", "2", "-j", "0", "-o", "swept", "-q").exit_code == 0
    written(home, CONTROLLER.replace("- self._agent.self_state", "- 2 * self._agent.self_state"))
    verb("trust", ".")
    second = symaware_cli.load("own.yaml").outline
    assert first is not None
    assert second is not None
    assert first.digest != second.digest


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scenario whose file notes that it was executed, with a log, a sweep and a branch of it."""
    folder = tmp_path_factory.mktemp("hostile")
    written(folder, HOSTILE.format(marker=str(folder)))

    def made(*words: str) -> None:
        with chdir(folder), pytest.MonkeyPatch.context() as patch:
            patch.setenv("XDG_CONFIG_HOME", str(folder / "configuration"))
            patch.setenv(HANDED_DOWN, "[]")
            assert in_process(*words).returncode == 0

    made("trust", ".")
    made("run", "own.yaml", "-q")
    made("run", "own.yaml", "-q", "-o", "own2.mcap")
    made("sweep", "own.yaml", "--runs", "2", "-j", "0", "-o", "swept", "-q")
    (folder / "paired.yaml").write_text(PAIRED)
    (folder / "case.yaml").write_text(
        "symaware-case: 1\nname: own\ngoals: {G1: {text: Near, by: [Sn1]}}\n"
        "solutions: {Sn1: {log: own.mcap, specification: near}}\n"
    )
    made("sweep", "paired.yaml", "-j", "0", "-o", "paired", "-q")
    assert (folder / "executed").exists()
    (folder / "executed").unlink()
    return folder


PAIRED = """\
symaware-sweep: 1
scenario: own.yaml
runs: 2
paired: true
variants: {slow: {run.duration: 0.4}, quick: {run.duration: 0.2}}
"""

#: The arguments of each verb, with a scenario, a log or a sweep that has hostile code.
VERBS = {
    "assure": ["case.yaml", "-o", "out6"],
    "explain": ["own.mcap"],
    "branch": ["own.mcap", "--at", "0.2", "-o", "out"],
    "budget": ["own.yaml", "--claim", "P(near) > 0.5", "--over", "run.duration=0.1,0.2", "-o", "out5", "-j", "0"],
    "certify": ["swept", "--claim", "P(near) > 0.5"],
    "check": ["own.mcap", "--again"],
    "compare": ["paired", "contacts"],
    "diff": ["own.mcap", "own.mcap"],
    "doctor": ["--quick"],
    "estimate": ["own.yaml", "--specification", "near", "-j", "0"],
    "export": ["own.mcap", "--format", "csv", "-o", "out"],
    "falsify": ["own.yaml", "--specification", "near", "--over", "run.duration=0.1..0.5 by 0.1"],
    "inspect": ["own.mcap"],
    "list": [],
    "log": ["events", "own.mcap"],
    "merge": ["own.mcap", "own2.mcap", "-o", "out.mcap"],
    "new": ["--help"],
    "plan": ["own.yaml"],
    "plot": ["own.mcap", "-o", "out.svg"],
    "recover": ["own.mcap", "-o", "out2.mcap"],
    "replay": ["own.mcap", "--save", "out.rrd"],
    "report": ["own.mcap", "-o", "out.html"],
    "resume": ["swept", "--add-runs", "2", "-j", "0"],
    "rows": ["swept"],
    "run": ["own.yaml"],
    "schema": [],
    "shares": ["swept"],
    "show": ["own.yaml"],
    "sweep": ["own.yaml", "--runs", "2", "-j", "2", "-o", "out3"],
    "trajectories": ["swept", "-o", "out4.svg"],
    "trust": [],
    "validate": ["own.yaml"],
    "verify": ["own.mcap"],
}

FURTHER = [
    ("run", ["own.mcap"]),
    ("run", ["swept", "--index", "0"]),
    ("run", ["own.yaml", "--join", "127.0.0.1:9", "--only", "robot.0", "--wait", "0.1"]),
    ("verify", ["swept"]),
    ("check", ["own.mcap"]),
    ("check", ["own.mcap", "--formula", "always position[0] < 9"]),
    ("inspect", ["swept"]),
    ("report", ["swept", "-o", "out5.html"]),
    ("plot", ["swept", "-o", "out6.svg"]),
    ("diff", ["swept", "swept"]),
    ("validate", ["own.mcap"]),
]


def test_every_verb_is_tried() -> None:
    assert {name.partition(" ")[0] for name in all_commands()} == VERBS.keys()


@pytest.mark.parametrize(
    ("name", "words"),
    [*VERBS.items(), *FURTHER],
    ids=lambda each: each if isinstance(each, str) else "-".join(each)[:40],
)
def test_no_verb_executes_untrusted_code(
    hostile: Path, verb: Verb, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str, words: list[str]
) -> None:
    monkeypatch.chdir(hostile)
    words = [str(tmp_path / each) if each.startswith("out") else each for each in words]
    done = verb(name, *words)
    assert not (hostile / "executed").exists()
    assert done.exit_code == 0 or name == "merge" or "is code, and it is not trusted" in done.output, done.output


def test_no_function_executes_untrusted_code(hostile: Path, tmp_path: Path) -> None:
    assert symaware_cli.open_log(hostile / "own.mcap").series("robot.1", "state").values.size
    functions: list[Callable[[], object]] = [
        lambda: symaware_cli.load(hostile / "own.yaml"),
        lambda: symaware_cli.Scenario(hostile / "own.mcap").run(record=False),
        lambda: symaware_cli.Scenario(hostile / "own.yaml").start(),
        lambda: symaware_cli.sweep(hostile / "own.yaml", runs=2, output=tmp_path / "out"),
        lambda: symaware_cli.verify_log(hostile / "own.mcap"),
        lambda: symaware_cli.check_log(hostile / "own.mcap", again=True),
        lambda: symaware_cli.branch(hostile / "own.mcap", at=0.2, output=tmp_path / "out.mcap"),
        lambda: symaware_cli.falsify(hostile / "own.yaml", "near", over={"run.duration": "0.1..0.5 by 0.1"}),
    ]
    for function in functions:
        with pytest.raises(symaware_cli.ScenarioError, match="is code, and it is not trusted"):
            function()
        assert not (hostile / "executed").exists()


def test_no_file_in_the_folder_grants_trust(hostile: Path, verb: Verb, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even a list of trusted folders, at any place where one might be looked for."""
    monkeypatch.chdir(hostile)
    kept = hostile / "configuration" / "symaware" / "trusted.json"
    for place in (".config/symaware", "symaware", "."):
        (hostile / place).mkdir(parents=True, exist_ok=True)
        (hostile / place / "trusted.json").write_bytes(kept.read_bytes())
    monkeypatch.setenv("XDG_CONFIG_HOME", ".")
    monkeypatch.setenv("HOME", "/nonexistent")
    assert verb("run", "own.yaml").exit_code == 2
    assert not (hostile / "executed").exists()


def test_the_option_is_where_one_scenario_is_run_or_repeated() -> None:
    """A folder is trusted for sweeps, which take long and are resumed."""
    options = {
        name for name, each in all_commands().items() if any("--trust" in parameter.opts for parameter in each.params)
    }
    assert options == {"branch", "check", "estimate", "explain", "falsify", "run", "show", "validate", "verify"}
