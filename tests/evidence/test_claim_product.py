"""The claims of several sweeps have a product if they are conditional on one another, of one distribution and apart."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from sweeping import symaware, tiny

import symaware_cli as sa
from symaware_cli.studies import SweepError

#: Both specifications that are added are always satisfied: the robots cannot get so far.
SPECIFICATIONS = (
    "--set",
    'specifications.low={each: robot, formula: "always position[1] < 9"}',
    "--set",
    'specifications.high={each: robot, formula: "always position[1] > -9"}',
)
FIRST, SECOND = "P(low) > 0.8 with confidence 0.98", "P(high | low) > 0.7 with confidence 0.99"


def swept(folder: Path, name: str, claim: str, seed: int, *options: object) -> Path:
    out = folder / name
    entries = ("--runs", 30, "--with", f"claim={claim}", "--seed", seed)
    symaware("sweep", tiny(folder), "-o", out, "--jobs", 0, "--quiet", *entries, *SPECIFICATIONS, *options)
    return out


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Path]:
    folder = tmp_path_factory.mktemp("product")
    return swept(folder, "first", FIRST, 1), swept(folder, "second", SECOND, 2)


def test_bounds_are_multiplied_and_error_probabilities_added(folders: Sequence[Path]) -> None:
    made = sa.certify_product(folders)
    assert made.is_established
    assert made.probability == pytest.approx(0.8 * 0.7)
    assert made.confidence == pytest.approx(1 - 0.02 - 0.01)
    assert str(made) == "P(low and high) > 0.56 with confidence 0.97"
    assert json.loads(symaware("certify", *folders, "--json")) == made.to_json()
    assert "P(low and high) > 0.56 with confidence 0.97: certified" in symaware("certify", *folders)


def test_a_product_is_established_only_if_all_its_factors_are(folders: Sequence[Path], tmp_path: Path) -> None:
    doubtful = swept(tmp_path, "doubtful", "P(near | low) > 0.7 with confidence 0.99", 3)
    made = sa.certify_product([folders[0], doubtful])
    assert [each.is_established for each in made.factors] == [True, False]
    assert not made.is_established
    assert "not established in" in symaware("certify", folders[0], doubtful, status=3)


def test_a_product_of_three_has_growing_conditions(folders: Sequence[Path], tmp_path: Path) -> None:
    both = swept(tmp_path, "both", "P(near | high and low) > 0.01 with confidence 0.9", 3)
    assert sa.certify_product([*folders, both]).satisfied == ["low", "high", "near"]


def test_the_order_of_conditions_counts(folders: Sequence[Path]) -> None:
    with pytest.raises(SweepError, match=r"which does not fit as the first factor: a claim there is of P\(high\)"):
        sa.certify_product(folders[::-1])


@pytest.mark.parametrize(
    ("claim", "problem"),
    [
        ("P(high) > 0.7", r"a claim there is of P\(high \| low\)"),
        ("P(high | near) > 0.001", r"a claim there is of P\(high \| low\)"),
        ("P(low) > 0.7", "`low` is claimed twice"),
        ("P(high | low) > 0.7; P(near) > 0.001", "has 2 terms, and a factor has one"),
    ],
)
def test_claims_without_a_product_are_refused(
    claim: str, problem: str, folders: Sequence[Path], tmp_path: Path
) -> None:
    with pytest.raises(SweepError, match=problem):
        sa.certify_product([folders[0], swept(tmp_path, "out", claim, 3)])


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (("--set", "run.duration=0.9"), "their scenarios differ"),
        (("--set", "agents.robot.model.with.max_speed=0.9"), "their scenarios differ"),
        (("--over", "agents.robot.model.with.max_speed={uniform: [0.9, 1.0]}"), "drawn in one of them"),
    ],
)
def test_runs_of_another_distribution_are_refused(
    options: Sequence[str], problem: str, folders: Sequence[Path], tmp_path: Path
) -> None:
    with pytest.raises(SweepError, match="not drawn from the same distribution") as raised:
        sa.certify_product([folders[0], swept(tmp_path, "out", SECOND, 3, *options)])
    assert problem in str(raised.value)


def test_runs_of_the_same_seeds_are_refused(folders: Sequence[Path], tmp_path: Path) -> None:
    with pytest.raises(SweepError, match="have a run with the same seed"):
        sa.certify_product([folders[0], swept(tmp_path, "out", SECOND, 1)])


@pytest.mark.parametrize("option", [("--claim", "P(low) > 0.5"), ("--key", "key.pem"), ("--output", "made.json")])
def test_options_for_one_sweep_are_refused_for_several(folders: Sequence[Path], option: Sequence[str]) -> None:
    assert f"{option[0]} is for a single sweep" in symaware("certify", *folders, *option, status=2)
