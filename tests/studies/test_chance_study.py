"""The study of maximal risks includes every controller, and a few of its runs are consistent with it."""

import importlib.util
import sys
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

import pytest
import yaml
from checkout import CHECKOUT

TOP = CHECKOUT


def program() -> ModuleType:
    """Return the program that runs the study."""
    spec = importlib.util.spec_from_file_location("chance_study", TOP / "benchmarks" / "chance.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


study = program()
SWEEPS = study.sweeps()


def controllers() -> set[str]:
    """Return all built-in components with a maximal risk, by name without the family."""
    found = set()
    for each in entry_points(group="symaware.components"):
        if each.value.startswith("symaware_cli.engine.components.control"):
            parameters = getattr(each.load(), "Parameters", None)
            if parameters is not None and "maximal_risk" in parameters.model_fields:
                found.add(each.name.removeprefix("control."))
    return found


def test_each_sweep_contains_every_controller_with_a_maximal_risk() -> None:
    pytest.importorskip("casadi", reason="CasADi is an extra")
    assert len(SWEEPS) == 4
    for sweep in SWEEPS:
        variants = yaml.safe_load(sweep.read_text())["variants"]
        for name in controllers():
            own = [each for each in variants if each == name or each.startswith(f"{name}-")]
            assert len(own) == (2 if sweep.stem == "chance-horizons" else 1), f"{name} in {sweep.name}"


def test_the_table_of_the_page_is_complete_and_consistent() -> None:
    lines = [line for line in (TOP / "docs" / "risk.md").read_text().splitlines() if line.startswith("| `chance-")]
    found = []
    for line in lines:
        sweep, variant, risk, violated, *_ = (each.strip(" `") for each in line.strip("|").split("|"))
        count, runs = violated.split(" of ")
        found.append(study.Row(sweep, variant, float(risk), int(runs), int(count)))
    expected = {(sweep.stem, variant) for sweep in SWEEPS for variant in yaml.safe_load(sweep.read_text())["variants"]}
    assert {(each.sweep, each.variant) for each in found} == expected
    assert len(found) == len(expected) == 15
    assert all(each.runs == 400 and each.keeps for each in found)
    assert study.failures(found) == []


@pytest.mark.parametrize(("risk", "most"), [(0.1, 55), (0.05, 31), (0.02, 15)])
def test_the_number_of_violations_is_limited_by_the_99_percent_binomial_quantile(risk: float, most: int) -> None:
    assert study.Row("any", "mpc", risk, 400, most).most == most
    assert study.Row("any", "mpc", risk, 400, most).keeps
    assert not study.Row("any", "mpc", risk, 400, most + 1).keeps


def test_a_controller_that_is_never_limited_is_inconclusive() -> None:
    rows = [study.Row("a", "mpc", 0.1, 400, 10), study.Row("b", "mpc-short", 0.1, 400, 3)]
    assert study.failures(rows) == ["mpc: the constraint binds nowhere"]
    assert study.failures([*rows, study.Row("b", "mpc-long", 0.1, 400, 11)]) == []


@pytest.mark.slow
@pytest.mark.parametrize("sweep", SWEEPS, ids=lambda path: path.stem)
def test_ten_runs_of_each_variant_are_consistent_with_the_maximal_risk(sweep: Path) -> None:
    pytest.importorskip("casadi", reason="CasADi is an extra")
    for row in study.rows(sweep, 10):
        assert row.runs == 10
        assert row.keeps, row
