"""Warnings of `validate`: agents without a body, and assumptions that no environment can keep."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli import Scenario
from symaware_cli.language.problem import ScenarioError

PILLAR = {"pillar": {"shape": {"circle": {"radius": 0.3}}, "position": [2.0, 0.0]}}
DISC = {"shape": {"circle": {"radius": 0.3}}}


def written(folder: Path, content: dict[str, Any]) -> Path:
    path = folder / "s.yaml"
    path.write_text(yaml.safe_dump({"symaware": 1, "name": "s", "run": {"duration": 1.0}, **content}, sort_keys=False))
    return path


def bodies(folder: Path, world: str, entities: dict[str, Any], **agents: dict[str, Any]) -> list[str]:
    groups = {
        name: {"model": {"use": "single-integrator"}, "state": [number, 5], **given}
        for number, (name, given) in enumerate(agents.items())
    }
    content = {"environment": {"use": world, "entities": entities}, "agents": groups}
    warnings = Scenario(written(folder, content)).validate().warnings
    assert all(warning.code == "no-body" and warning.span for warning in warnings)
    return [warning.path for warning in warnings]


@pytest.mark.parametrize("world", ["kinematic", "pymunk", "pybullet"])
def test_an_agent_without_a_body_is_reported_where_it_could_collide(world: str, tmp_path: Path) -> None:
    assert bodies(tmp_path, world, PILLAR, a={}, b={"entity": {"mass": 2.0}}) == ["agents.a", "agents.b"]
    assert bodies(tmp_path, world, {}, a={}, b={"entity": DISC}) == ["agents.a"]
    assert bodies(tmp_path, world, PILLAR, a={"entity": DISC}) == []


def test_a_missing_body_is_not_reported_without_objects_to_collide_with(tmp_path: Path) -> None:
    assert bodies(tmp_path, "kinematic", {}, a={}, b={}) == []


def test_a_deliberate_point_is_not_reported(tmp_path: Path) -> None:
    assert bodies(tmp_path, "kinematic", PILLAR, a={"entity": {"shape": None}}) == []


@pytest.mark.parametrize("world", ["kinematic", "pybullet"])
def test_a_vehicle_brings_its_body_along(world: str, tmp_path: Path) -> None:
    assert bodies(tmp_path, world, PILLAR, car={"model": {"use": "racecar"}, "state": [0, 0, 0, 0, 0]}) == []


def strategy(folder: Path, assumptions: list[str], guarantees: list[str], graph: str = "") -> Path:
    given = "transitions: {l0: [l0, l1], l1: [l0, l1, l2], l2: [l1, l2]}\ninitial: [l0]"
    (folder / "g.yaml").write_text(graph or given)
    decide = {"model": "loc", "labels": {"x": "knowledge.x > 0", "y": "knowledge.x > 1"}, "assumptions": assumptions}
    agent = {
        "model": {"use": "single-integrator", "with": {"max_speed": 2.0}},
        "state": [0.5, 0.5],
        "knowledge": {"x": 1.0},
        "components": {
            "sense": {"use": "perception.omniscient"},
            "decide": {"use": "knowledge.strategy", "with": {**decide, "guarantees": guarantees}},
            "steer": {"use": "control.cells", "with": {"model": "loc"}},
        },
    }
    content = {
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "regions": {f"l{number}": {"box": [number, number + 1, 0, 1]} for number in range(3)},
        "knowledge_models": {"loc": {"use": "abstraction.file", "with": {"graph": {"file": "g.yaml"}}}},
        "agents": {"a": agent},
    }
    return written(folder, content)


@pytest.fixture(autouse=True)
def without_a_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.mark.parametrize(
    ("assumptions", "place"),
    [
        ([], None),
        (["always eventually x"], None),
        (["always eventually x", "always eventually not x"], None),
        (["always (x implies next not x)", "always eventually x"], None),
        (["always (l1 implies next not x)", "always eventually x"], None),
        (["always eventually (x and not x)"], "0"),
        (["always eventually x", "always eventually (y and not y)"], "1"),
        (["always not x", "always eventually x"], ""),
        (["always (x implies next x)", "always (not x implies next not x)", "always eventually x", "not x"], ""),
        (["always eventually (l0 and l1)"], "0"),
    ],
)
def test_assumptions_that_no_environment_can_keep_are_reported(
    assumptions: list[str], place: str | None, tmp_path: Path
) -> None:
    warnings = Scenario(strategy(tmp_path, assumptions, ["always eventually l1"])).validate().warnings
    path = "agents.a.components.decide.with.assumptions" + (f"[{place}]" if place else "")
    assert [warning.path for warning in warnings] == ([] if place is None else [path])


def test_an_agent_that_begins_elsewhere_than_its_model_is_refused(tmp_path: Path) -> None:
    graph = "transitions: {l0: [l0, l1], l1: [l0, l1, l2], l2: [l1, l2]}\ninitial: [l2]"
    with pytest.raises(ScenarioError) as refused:
        Scenario(strategy(tmp_path, [], ["always eventually l1"], graph)).validate()
    (problem,) = refused.value.problems
    assert "a begins in `l0`, which is no initial state of the knowledge model; there are: `l2`" in problem.message
    assert problem.path == "agents.a.components.decide.with.model"
