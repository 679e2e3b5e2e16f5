"""A package of plugins is built, installed beside SymAware and used, all from outside the checkout."""

import json
import os
import re
import subprocess
import sys
import venv
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

CHECKOUT = Path(__file__).parent.parent
EXAMPLE = CHECKOUT / "plugins" / "symaware-example"

#: One process prepares the environment that all of these tests look at.
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("plugin package")]


def documented(folder: Path) -> Path:
    """Write the package with a verb of docs/plugins.md."""
    text = (CHECKOUT / "docs" / "plugins.md").read_text(encoding="utf-8")
    for language, name in (("toml", "pyproject.toml"), ("python", "symaware_distance.py")):
        (block,) = re.findall(rf"(?ms)^```{language}\n(# {re.escape(name)}\n.*?)^```$", text)
        (folder / name).write_text(block, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The three wheels, built from copies of what git knows or would know."""
    folder = tmp_path_factory.mktemp("wheels")
    built: list[Any] = []
    for source in (CHECKOUT, EXAMPLE, documented(tmp_path_factory.mktemp("documented"))):
        subprocess.run(
            [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, source],
            check=True,
            cwd=folder,
            timeout=300,
        )
        (new,) = set(folder.glob("*.whl")) - set(built)
        built.append(new)
    return built


@pytest.fixture(scope="module")
def elsewhere(
    wheels: list[Path], tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run a command of a fresh environment that has these wheels, in a folder far from the checkout."""
    folder = tmp_path_factory.mktemp("elsewhere")
    venv.create(folder / "venv", with_pip=True)
    python = folder / "venv" / "bin" / "python"
    # Otherwise pip takes what is on the PYTHONPATH for installed.
    outside = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    subprocess.run(
        [python, "-m", "pip", "install", "--quiet", "--no-compile", *wheels, "pytest"],
        env=outside,
        check=True,
        timeout=600,
    )
    (folder / "work").mkdir()

    def run(program: str, *arguments: object) -> subprocess.CompletedProcess[str]:
        line: list[str | Path] = [folder / "venv" / "bin" / program, *map(str, arguments)]
        done = subprocess.run(
            line, cwd=folder / "work", env=outside, capture_output=True, text=True, timeout=300, check=False
        )
        assert "Traceback" not in done.stderr, done.stderr
        return done

    return run


def test_the_wheel_holds_the_package_its_marker_of_types_and_nothing_else(wheels: list[Path]) -> None:
    names = zipfile.ZipFile(wheels[0]).namelist()
    assert "symaware_cli/py.typed" in names
    assert "symaware_cli/testing/__init__.py" in names
    written = {
        path.relative_to(CHECKOUT).as_posix()
        for path in (CHECKOUT / "symaware_cli").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    information = [name for name in names if ".dist-info/" in name]
    assert set(names) - set(information) == written
    assert {name.partition("/")[2] for name in information} == {
        *("METADATA", "WHEEL", "entry_points.txt", "licenses/LICENSE", "RECORD")
    }
    assert {name for name in zipfile.ZipFile(wheels[1]).namelist() if ".dist-info/" not in name} == {
        *("symaware_example/__init__.py", "symaware_example/patrol.py", "symaware_example/py.typed"),
        "symaware_example/telling.py",
    }


def test_the_example_uses_the_public_api_only() -> None:
    for file in (EXAMPLE / "src").rglob("*.py"):
        for line in file.read_text().splitlines():
            if "symaware_cli" in line:
                assert line.startswith("from symaware_cli import"), f"{file.name}: {line}"


def test_a_fresh_environment_lists_shows_and_describes_the_plugins(
    elsewhere: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    listed = elsewhere("symaware", "list", "components")
    assert listed.returncode == 0
    assert "example.patrol" in listed.stdout
    assert "symaware-example 0.1.0" in listed.stdout
    assert "symaware_cli" not in elsewhere("python", "-c", "import os; print(os.listdir())").stdout

    shown = elsewhere("symaware", "show", "example.patrol")
    assert shown.returncode == 0
    for said in ("Speed [m/s].", "tolerance", "waypoint-reached", "waypoints"):
        assert said in shown.stdout

    schema = json.loads(elsewhere("symaware", "schema").stdout)
    assert set(schema["$defs"]["component:example.patrol"]["properties"]) == {"speed", "tolerance"}
    built_in = json.loads(elsewhere("symaware", "schema", "--built-in").stdout)
    assert not [name for name in built_in["$defs"] if "example" in name]


def test_a_fresh_environment_validates_and_runs_the_examples_scenario(
    elsewhere: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    scenario = EXAMPLE / "scenarios" / "rounds.yaml"
    validated = elsewhere("symaware", "validate", scenario)
    assert validated.returncode == 0, validated.stderr
    done = elsewhere("symaware", "run", scenario, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["status"] == "finished"
    inspected = elsewhere("symaware", "inspect", "rounds.mcap")
    assert inspected.returncode == 0
    assert "waypoint-reached" in inspected.stdout
    versions = json.loads(elsewhere("symaware", "inspect", "rounds.mcap", "--json").stdout)["versions"]
    assert versions["symaware-example"] == "0.1.0"


def test_a_fresh_environment_passes_the_examples_own_tests(
    elsewhere: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    done = elsewhere("python", "-m", "pytest", "-q", "-p", "no:cacheprovider", EXAMPLE / "tests")
    assert done.returncode == 0, done.stdout


def test_a_fresh_environment_has_the_verb_of_the_documentation(
    elsewhere: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    assert "Print how far each agent has moved" in elsewhere("symaware", "--help").stdout
    assert elsewhere("symaware", "run", CHECKOUT / "scenarios" / "hello.yaml", "-q").returncode == 0
    done = elsewhere("symaware", "distance", "hello.mcap", "--digits", "2")
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"(robot\.\d: \d+\.\d\d m\n){4}", done.stdout)
    assert elsewhere("symaware", "distance", "nowhere.mcap").returncode == 2


def test_a_parameter_out_of_range_is_located_in_the_file(
    elsewhere: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    done = elsewhere(
        *("symaware", "validate", EXAMPLE / "scenarios" / "rounds.yaml"),
        *("--set", "agents.guard.components.patrol.with.speed=-1"),
    )
    assert done.returncode == 2
    assert "speed" in done.stderr


def blocks_of(page: str, language: str) -> list[str]:
    """The fenced blocks of a page of docs/."""
    text = (CHECKOUT / "docs" / page).read_text(encoding="utf-8")
    return re.findall(rf"(?ms)^```{language}\n(.*?)^```$", text)


def test_from_an_empty_folder_to_an_own_controller_in_three_commands_and_a_file_of_eight_lines(
    elsewhere: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    text = blocks_of("own-code.md", "python")[0].removeprefix("# controllers.py\n")
    assert len([line for line in text.splitlines() if line]) <= 8
    write = f"import pathlib; pathlib.Path('controllers.py').write_text({text!r})"
    assert elsewhere("python", "-c", write).returncode == 0
    changed = ["--plugin", "controllers.py", "--set", "agents.robot.components.steer={use: controllers.pursue}"]
    for command in (["new", "mine"], ["run", "mine.yaml", *changed], ["verify", "mine.mcap", "--trust"]):
        done = elsewhere("symaware", *command)
        assert done.returncode == 0, done.stderr
    assert elsewhere("symaware", "verify", "mine.mcap").returncode == 2, "nobody trusts the file of the log by itself"


SCENARIO_CELL = """\
scenario = sa.scenario({
    "symaware": 1,
    "name": "cells",
    "run": {"duration": 5},
    "environment": {"use": "kinematic"},
    "agents": {
        "robot": {
            "model": {"use": "unicycle"},
            "knowledge": {"goal": [5, 0]},
            "components": {"steer": {"use": pursue}},
        }
    },
})
"""

RUN_CELL = """\
run = scenario.run(output="cells.mcap")
print(run.status, round(float(run.series("robot", "world").values[-1][0]), 1))
"""

NOTEBOOK = """\
space = {"__name__": "__main__"}
for number, cell in enumerate(CELLS):
    exec(compile(cell, f"<cell {number}>", "exec"), space)
"""


def test_the_same_in_three_cells_of_a_notebook(elsewhere: Callable[..., subprocess.CompletedProcess[str]]) -> None:
    """The cells are compiled as a notebook's are, each with a name of its own."""
    controller = blocks_of("own-code.md", "python")[0]
    cells = [f"import symaware_cli as sa\n{controller}", SCENARIO_CELL, RUN_CELL]
    done = elsewhere("python", "-c", f"CELLS = {cells!r}\n{NOTEBOOK}")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["finished", "4.0"]
    assert "was defined by the program" in elsewhere("symaware", "verify", "cells.mcap").stderr
