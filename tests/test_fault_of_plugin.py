"""A kind of fault from outside: one file and one entry point in a wheel, used far from the checkout."""

import base64
import hashlib
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from documented_plugins import command
from rerun_files import Recording
from simulating import Command
from test_documents import TOP, blocks

from symaware_cli import open_log

#: One process prepares what all of these tests look at.
pytestmark = pytest.mark.xdist_group("plugin of a fault")

#: The page that shows the plugin, its entry point and a scenario with it.
DOCUMENT = TOP / "docs" / "time.md"

#: Captures a state while the fault lasts, and continues from it in another simulation.
RESTORE = """
import symaware_cli as sa

def rest(simulation):
    told = []
    while not simulation.done:
        simulation.step()
        told.append((simulation.now, simulation.belief("robot").tobytes(), simulation.state("robot").tobytes()))
        told += [(event.name, event.text) for event in simulation.events]
    return told

scenario = sa.load("drift.yaml")
with scenario.start() as simulation:
    simulation.step(45)
    state = simulation.capture().to_bytes()
    whole = rest(simulation)
    simulation.restore(sa.SimulationState.from_bytes(state))
    again = rest(simulation)
with scenario.start() as simulation:
    simulation.restore(sa.SimulationState.from_bytes(state))
    assert whole == again == rest(simulation)
print([each for each in whole if each[0] == "fault-over"])
"""


def shown(beginning: str) -> str:
    """The block of the page that begins so."""
    (found,) = [block.text for block in blocks(DOCUMENT) if block.text.startswith(beginning)]
    return found


def wheel(folder: Path) -> Path:
    """Build the wheel of the plugin; the format is that of packaging.python.org, "Binary distribution format"."""
    points = shown("[project.entry-points").replace("project.entry-points.", "").replace('"', "")
    about = "my_package-0.1.0.dist-info"
    files = {
        "my_package.py": shown('"""Sensors whose measurements drift'),
        f"{about}/METADATA": "Metadata-Version: 2.1\nName: my-package\nVersion: 0.1.0\n",
        f"{about}/WHEEL": "Wheel-Version: 1.0\nGenerator: tests\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{about}/entry_points.txt": points,
    }
    digests = {
        name: base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).decode().rstrip("=")
        for name, text in files.items()
    }
    record = [f"{name},sha256={digests[name]},{len(text.encode())}" for name, text in files.items()]
    files[f"{about}/RECORD"] = "\n".join([*record, f"{about}/RECORD,,", ""])
    path = folder / "my_package-0.1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return path


@pytest.fixture(scope="module")
def outside(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder far from the checkout, with the scenario; the plugin is installed in its folder ``site``."""
    folder = tmp_path_factory.mktemp("outside")
    install = ["install", "--quiet", "--no-index", "--no-deps", "--no-compile", "--disable-pip-version-check"]
    subprocess.run(
        [sys.executable, "-m", "pip", *install, "--target", folder / "site", wheel(folder)], check=True, timeout=300
    )
    (folder / "drift.yaml").write_text(shown("# drift.yaml"), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def symaware(outside: Path) -> Command:
    return command(outside)


@pytest.fixture(scope="module")
def log(symaware: Command, outside: Path) -> Path:
    symaware("run", "drift.yaml", "--quiet", "--output", "drift.mcap", process=True)
    return outside / "drift.mcap"


def test_the_plugin_is_one_file_and_one_entry_point(outside: Path) -> None:
    assert [path.name for path in (outside / "site").glob("*.py")] == ["my_package.py"]
    (about,) = (outside / "site").glob("*.dist-info")
    assert about.joinpath("entry_points.txt").read_text().split("\n")[:2] == [
        *("[symaware.faults]", "mine-drift = my_package:Drift")
    ]


def test_the_kind_is_listed_shown_and_part_of_the_schema(symaware: Command) -> None:
    listed = json.loads(symaware("list", "faults", "--json").stdout)
    assert ("mine-drift", "my-package") in {(each["name"], each["package"]) for each in listed}
    assert "Drift, in the model's order" in symaware("show", "mine-drift").stdout
    definitions = json.loads(symaware("schema").stdout)["$defs"]
    assert set(definitions["fault:mine-drift"]["properties"]) == {"of", "rate"}
    assert "measurements" in definitions["FaultUse"]["properties"]["mine-drift"]["description"]
    assert "mine-drift" not in symaware("schema", "--built-in").stdout


@pytest.mark.parametrize(
    ("was", "becomes", "problem"),
    [
        ("mine-drift", "mine-drfit", "drift.yaml:16:29: unknown key `mine-drfit`"),
        ("rate: [0.0, 0.4]", "rate: [0.4]", "drift.yaml:16:65: there are 1 numbers for a state of 2"),
        ("rate: [0.0, 0.4]", "rate: [0, 0]", "drift.yaml:16:65: a rate of 0 has no effect"),
        ("robot.1.see,", "robot.1.sea,", "drift.yaml:16:46: there is no component `robot.1.sea`"),
        ("rate: [0.0, 0.4]", "rate: fast", "drift.yaml:16:65: `faults.tide.mine-drift.rate` is the text `fast`"),
        (", rate: [0.0, 0.4]", "", "drift.yaml:16:29: the field `rate` is missing in `faults.tide.mine-drift`"),
    ],
)
def test_a_problem_is_located(symaware: Command, outside: Path, was: str, becomes: str, problem: str) -> None:
    (outside / "wrong").mkdir(exist_ok=True)
    text = (outside / "drift.yaml").read_text()
    assert text.count(was) == 1
    (outside / "wrong" / "drift.yaml").write_text(text.replace(was, becomes))
    refused = symaware("validate", "wrong/drift.yaml", status=2).stderr
    assert refused.startswith(f"wrong/{problem}"), refused
    assert becomes != "mine-drfit" or "did you mean `mine-drift`?" in refused


def test_without_the_plugin_its_key_is_unknown(symaware: Command) -> None:
    assert "unknown key `mine-drift`" in symaware("validate", "drift.yaml", status=2, plugin=False).stderr
    symaware("validate", "drift.yaml")


def test_the_effect_lasts_as_long_as_the_scenario_says(log: Path) -> None:
    read = open_log(log)
    for agent in ("robot.0", "robot.1"):
        believed, true = read.series(agent, "state"), read.series(agent, "world")
        times = believed.times / 1e9
        error = believed.values - true.values[np.searchsorted(true.times, believed.times)]
        drifts = (times > 1.1) & (times < 2.9) & (agent == "robot.1")
        assert (np.abs(error[drifts, 1]) > 0.03).all()
        assert np.allclose(error[(times < 1) | (times >= 3)], 0, atol=0.1)
    told = [(event.time / 1e9, event.name, event.source) for event in read.events() if "fault" in event.name]
    assert told == [(1.0, "fault", "agents.robot.1.see"), (3.0, "fault-over", "agents.robot.1.see")]


def test_replays_and_plots_show_it_also_without_the_plugin(symaware: Command, outside: Path, log: Path) -> None:
    symaware("replay", log.name, "--save", "drift.rrd", plugin=False)
    rows = Recording(outside / "drift.rrd").rows
    texts = [str(value) for (entity, _), each in rows.items() if entity == "/log/events" for _, value in each]
    assert any("tide: lets the measurements of robot.1.see drift for 2 s" in text for text in texts)
    symaware("plot", log.name, "--output", "drift.svg", plugin=False)


def test_a_state_captured_while_it_lasts_is_restored(outside: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(outside / "site")}
    line = [sys.executable, "-P", "-c", RESTORE]
    done = subprocess.run(line, cwd=outside, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert done.stdout.strip() == "[('fault-over', 'tide: over')]", done.stderr


def test_a_branch_begins_with_another_one(symaware: Command, log: Path, outside: Path) -> None:
    change = "faults.ebb={mine-drift: {of: robot.0.see, rate: [0.3, 0.0]}}"
    symaware("branch", log.name, "--at", "2.0", "--set", change, "--output", "branch.mcap", "--quiet")
    told = [event.text for event in open_log(outside / "branch.mcap").events() if event.name == "fault"]
    assert told == [
        "tide: lets the measurements of robot.1.see drift for 2 s",
        "ebb: lets the measurements of robot.0.see drift",
    ]


def test_the_log_alone_suffices_to_repeat_the_run(symaware: Command, log: Path) -> None:
    symaware("verify", log.name)
