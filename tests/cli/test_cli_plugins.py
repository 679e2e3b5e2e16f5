"""`symaware list`, `show` and `schema`: what is installed."""

import json
from pathlib import Path

import jsonschema
import pytest
import yaml
from checkout import CHECKOUT
from simulating import Command


def test_the_list_has_every_plugin_and_its_package(command: Command) -> None:
    done = command("list")
    assert (done.returncode, done.stderr) == (0, "")
    for said in ("components", "environments", "models", "perception.self", "kinematic", "unicycle", "symaware-cli 0."):
        assert said in done.stdout
    listed = json.loads(command("list", "--json").stdout)
    assert {"kind", "name", "package", "version", "class"} == set(listed[0])
    assert {"component", "environment", "model"} <= {each["kind"] for each in listed}


def test_one_kind_may_be_listed_alone(command: Command) -> None:
    done = command("list", "models")
    assert "unicycle" in done.stdout
    assert "kinematic" not in done.stdout


def test_listing_imports_no_plugin_and_a_broken_one_breaks_nothing_else(
    process: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    information = tmp_path / "installed" / "broken-1.0.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[symaware.components]\nbroken.one = broken_plugin:One\n")
    (tmp_path / "installed" / "broken_plugin.py").write_text("raise RuntimeError('broken on purpose')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "installed"))
    listed = process("list", "components")
    assert listed.returncode == 0
    assert "broken.one" in listed.stdout
    shown = process("show", "broken.one")
    assert shown.returncode == 2
    assert "RuntimeError: broken on purpose" in shown.stderr
    schema = process("schema")
    assert schema.returncode == 0
    assert "left out: the component `broken.one`" in schema.stderr
    assert "component:control.go-to-goal" in json.loads(schema.stdout)["$defs"]


def test_a_plugin_is_shown_with_parameters_units_defaults_and_events(command: Command) -> None:
    done = command("show", "control.go-to-goal")
    assert done.returncode == 0
    for said in ("speed", "default 1.0", "[m/s]", "goal-reached", "Requires the knowledge", "number > 0"):
        assert said in done.stdout
    (shown,) = json.loads(command("show", "control.go-to-goal", "--json").stdout)
    assert shown["name"] == "control.go-to-goal"
    assert {"speed", "tolerance"} <= {parameter["name"] for parameter in shown["parameters"]}


def test_a_model_is_shown_with_its_state_and_control_input(command: Command) -> None:
    done = command("show", "unicycle")
    assert "heading" in done.stdout
    assert "rad/s" in done.stdout


def test_the_knowledge_models_of_a_scenario_are_drawn(command: Command, tmp_path: Path) -> None:
    scenarios = CHECKOUT / "scenarios"
    shown = json.loads(command("show", scenarios / "door.yaml", "--output", "floor.svg", "--json").stdout)
    assert shown["models"] == {"floor": {"cells": 31, "transitions": 123}}
    assert "<svg" in (tmp_path / "floor.svg").read_text()
    without = command("show", scenarios / "hello.yaml")
    assert without.returncode == 2
    assert "has no knowledge models" in without.stderr


@pytest.mark.parametrize(
    ("file", "status", "said"),
    [
        ("floor.jpg", 2, "cannot draw floor.jpg: the suffix '.jpg' is not a known format; use .png, .svg, "),
        ("floor", 2, "cannot draw floor: a name without a suffix is not a known format"),
        ("nowhere/floor.png", 1, "cannot write nowhere/floor.png: its folder does not exist"),
    ],
)
def test_a_figure_of_knowledge_models_that_cannot_be_written_is_refused_in_a_sentence(
    file: str, status: int, said: str, command: Command, tmp_path: Path
) -> None:
    refused = command("show", CHECKOUT / "scenarios" / "door.yaml", "--output", file)
    assert refused.returncode == status
    assert said in refused.stderr
    assert "Traceback" not in refused.stderr
    assert not list(tmp_path.glob("*floor*"))


def test_a_misspelt_plugin_is_answered_with_the_nearest(command: Command) -> None:
    done = command("show", "unicicle")
    assert (done.returncode, done.stdout) == (2, "")
    assert "did you mean `unicycle`?" in done.stderr
    assert "unicycle" in json.loads(command("show", "unicicle", "--json").stdout)["error"]


def test_the_schema_accepts_the_examples_and_refuses_misspelt_keys(command: Command, scenarios: Path) -> None:
    done = command("schema")
    assert done.returncode == 0
    schema = json.loads(done.stdout)
    hello = yaml.safe_load((scenarios / "hello.yaml").read_text())
    jsonschema.validate(hello, schema)
    hello["agents"]["robot"]["components"]["steer"]["with"]["sped"] = 1.0
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(hello, schema)


def test_the_schema_can_be_written_to_a_file(command: Command, tmp_path: Path) -> None:
    assert command("schema", "--built-in", "-o", "schema.json").returncode == 0
    assert json.loads((tmp_path / "schema.json").read_text())["$schema"].startswith("https://json-schema.org/")
    done = command("schema", "-o", "missing/schema.json")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
