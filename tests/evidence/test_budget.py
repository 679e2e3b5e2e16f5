"""A budget certifies levels from mild to severe, and is wrong at most as often as it claims."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom
from test_contracts import SCENARIO

import symaware_cli as sa
from symaware_cli.evidence.budgeting import fixed_sequence
from symaware_cli.evidence.severity_grid import severity_grid
from symaware_cli.language.build import build
from symaware_cli.studies import Claim

pytest.importorskip("pyarrow")

CLAIM = "P(sees) > 0.8 with confidence 0.9"
REPEATS = 3000


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "aware.yaml"
    path.write_text(SCENARIO.replace("duration: 1.0", "duration: 0.2"))
    return path


@pytest.mark.parametrize(
    "chances",
    [
        [0.0, 0.02, 0.05, 0.08, 0.1, 0.13, 0.2, 0.4],  # monotone; the critical level is the fifth, at the bound
        [0.01, 0.1, 0.0, 0.0, 0.3, 0.0],  # not monotone: levels after the first false one are true
        [0.1] * 8,  # all at the bound
    ],
)
@pytest.mark.parametrize("rule", ["fixed", "sequential"])
def test_a_level_that_is_too_severe_is_certified_no_more_often_than_claimed(chances: list[float], rule: str) -> None:
    """The chances are those of a failure at each level; the claim is that they are below 0.1."""
    alpha, runs = 0.05, 200
    claim = Claim.parse(f"P(safe) > 0.9 with confidence {1 - alpha}, {rule}")
    term = claim.terms[0]
    # The least number of runs that establish the claim with each number of failures.
    needed = np.array([claim.runs_needed(term, failures, 1) for failures in range(runs // 5)])
    random = np.random.default_rng(1)
    critical = next(level for level, chance in enumerate(chances) if chance >= 0.1)
    errors = certified = 0
    for _ in range(REPEATS):

        def is_certified(level: int) -> bool:
            failures = np.cumsum(random.random(runs) < chances[level])
            enough = np.arange(1, runs + 1) >= needed[np.minimum(failures, len(needed) - 1)]
            return bool(enough.any() if rule == "sequential" else enough[-1])

        count = fixed_sequence(range(len(chances)), is_certified)
        errors += count > critical
        certified += count > 0
    assert errors <= binom.ppf(0.99, REPEATS, alpha)
    assert certified > 0


def test_levels_after_the_first_that_is_not_certified_are_not_tested() -> None:
    tested: list[int] = []

    def is_certified(level: int) -> bool:
        tested.append(level)
        return level != 2

    assert fixed_sequence(range(9), is_certified) == 2
    assert tested == [0, 1, 2]


def test_a_budget_has_a_certificate_of_each_level_it_certifies(scenario: Path) -> None:
    out = scenario.parent / "out"
    found = sa.budget(scenario, out, claim=CLAIM, over="noise=0.1,0.15,5,6", runs=30)
    assert (found.certified_up_to, found.certified) == (0.15, 2)
    assert [each.is_certified for each in found.tested] == [True, True, False]
    assert found.grid.paths == ["agents.robot.components.sense.with.position_noise"]
    assert (out / "level-001" / "certificate.json").is_file()
    assert not (out / "level-002" / "certificate.json").exists()
    assert json.loads((out / "budget.json").read_text()) == found.to_json()
    # The whole grid was planned beforehand, and a second call continues it.
    assert (out / "level-003" / "sweep.yaml").is_file()
    assert sa.budget(scenario, out, claim=CLAIM, over="noise=0.1,0.15,5,6", runs=30).to_json() == found.to_json()
    with pytest.raises(sa.SweepError, match="sweep"):
        sa.budget(scenario, out, claim=CLAIM, over="noise=0.1,0.2,5,6", runs=30)


def test_a_range_shrinks(scenario: Path) -> None:
    grid = severity_grid("range", build(scenario))
    assert grid.values == [8.0, 7.2, 6.4, 5.6, 4.8, 4.0, 3.2, 2.4, 1.6, 0.8]
    assert grid.changes(1) == {"agents.robot.components.sense.with.range": 7.2}


@pytest.mark.parametrize(
    ("over", "said"),
    [
        ("nois", "there is no degradation `nois`"),
        ("loss", "the scenario has no `topology`"),
        ("noise=1,0", "the values of `noise` ascend"),
        ("range=1,2", "the values of `range` descend"),
        ("noise=0,0,1", "the level 0 occurs twice"),
        ("noise=a,b", "are numbers"),
        ("noise=0.5..1", "has no step"),
        ("agents.robot.cuont=1,2", "cuont"),
    ],
)
def test_invalid_grids_are_refused_before_anything_runs(scenario: Path, over: str, said: str) -> None:
    out = scenario.parent / "out"
    with pytest.raises(sa.ScenarioError, match=said):
        sa.budget(scenario, out, claim=CLAIM, over=over)
    assert not out.exists()
