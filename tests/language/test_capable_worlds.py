"""Messages about worlds that lack something name the installed ones that have it."""

import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli.language.build import build
from symaware_cli.language.capable_worlds import expected_world, worlds_that_provide
from symaware_cli.language.catalogue import Catalogue
from symaware_cli.language.problem import Problem, ScenarioError

SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "pushed",
    "run": {"duration": 0.2},
    "environment": {"use": "pybullet", "entities": {"ball": {"shape": {"circle": {"radius": 0.5}}, "mass": 1.0}}},
    "agents": {"robot": {"model": {"use": "unicycle"}, "state": [0, 0, 0]}},
}
SCENARIO["environment"]["entities"]["ball"]["position"] = [3, 0]


def problems(path: Path, *overrides: Any) -> list[Problem]:
    path = path / "pushed.yaml"
    path.write_text(yaml.safe_dump(SCENARIO))
    with pytest.raises(ScenarioError) as caught:
        build(path, overrides)
    return list(caught.value.problems)


@pytest.fixture
def without_pybullet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pybullet", None)
    for name in ("bullet", "spatial"):
        monkeypatch.delitem(sys.modules, f"symaware_cli.worlds.{name}", raising=False)


def test_worlds_are_found_by_their_features() -> None:
    catalogue = Catalogue()
    assert {"kinematic"}.isdisjoint(worlds_that_provide("forces", catalogue))
    assert "pymunk" in worlds_that_provide("forces", catalogue)
    assert "pymunk" not in worlds_that_provide("images", catalogue)
    assert worlds_that_provide("smells", catalogue) == []


def test_a_world_that_is_not_installed_is_replaced_by_one_that_would_run_the_scenario(
    without_pybullet: None, tmp_path: Path
) -> None:
    (problem,) = problems(tmp_path)
    assert problem.code == "missing-extra"
    assert problem.expected is not None
    assert "pip install 'symaware-cli[pybullet]'; or " in problem.expected
    assert "`pymunk`" in problem.expected
    assert problem.expected.endswith("which would run this scenario")


def test_a_world_that_cannot_run_the_scenario_is_not_named(without_pybullet: None, tmp_path: Path) -> None:
    (problem,) = problems(tmp_path, "environment.entities.ball.pitch=0.1")
    assert "`pymunk`" not in (problem.expected or "")


def test_an_unknown_name_is_reported_with_worlds_that_would_run_the_scenario(tmp_path: Path) -> None:
    (problem,) = problems(tmp_path, "environment.use=unreal")
    assert problem.code == "unknown-plugin"
    assert "which would run this scenario" in (problem.expected or "")


def test_a_feature_that_no_installed_world_has_is_reported_with_the_missing_packages(without_pybullet: None) -> None:
    said = expected_world("smells", Catalogue())
    assert said.startswith("a world that provides smells; no installed one does, but `pybullet` may, with the extra")


def test_worlds_with_forces_are_named_if_forces_are_lacking(tmp_path: Path) -> None:
    found = problems(tmp_path, "environment.use=kinematic", "environment.entities.ball.velocity=[1, 0]")
    assert [each.path for each in found] == ["environment.entities.ball"]
    assert "a world that moves bodies by forces: " in (found[0].expected or "")
    assert "`pymunk`" in (found[0].expected or "")
