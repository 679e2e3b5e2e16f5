"""Consistent forgeries of a sweep folder: the levels of verification that detect them; `all` detects every one."""

import os
import random
import shutil
from collections import Counter
from itertools import cycle, islice
from pathlib import Path

import pytest
from forging import KINDS, SCENARIO, SWEEP, Forger
from sweeping import symaware

import symaware_cli as sa
from symaware_cli.evidence.sweep_verification import LEVELS, Level


@pytest.fixture(scope="module")
def certified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a certified sweep, sound at all levels."""
    folder = tmp_path_factory.mktemp("certified")
    (folder / "passing.yaml").write_text(SCENARIO)
    (folder / "sweep.yaml").write_text(SWEEP)
    symaware("sweep", folder / "sweep.yaml", "-o", folder / "out", "--jobs", 0, "--quiet")
    assert sa.certify(folder / "out").is_established
    assert is_sound(folder / "out", "all")
    return folder / "out"


def is_sound(folder: Path, level: Level, seed: int = 0) -> bool:
    """Verify the folder, with its certificate if no run is repeated; `sample` repeats one of three rows."""
    if level in ("arithmetic", "monitor"):
        return sa.verify_certificate(folder / "certificate.json", level, rows=1, seed=seed).is_sound
    return sa.verify_sweep(folder, level, rows=1, seed=seed).is_sound


def level_that_finds(folder: Path, seed: int) -> str:
    if not is_sound(folder, "monitor", seed):  # which repeats `arithmetic`
        return "monitor" if is_sound(folder, "arithmetic", seed) else "arithmetic"
    return next((level for level in LEVELS[2:] if not is_sound(folder, level, seed)), "none")


def forged(certified: Path, folder: Path, cases: int) -> dict[str, Counter[str]]:
    """Create forgeries of each kind, and count for each kind the levels that first detected them."""
    found = {kind: Counter[str]() for kind in KINDS}
    for case, kind in enumerate(islice(cycle(KINDS), cases)):
        out = folder / str(case)
        shutil.copytree(certified, out)
        Forger(out, random.Random(case)).forge(kind)
        level = level_that_finds(out, cases + case)  # a different seed from that of the forger
        assert level != "none", f"case {case}, {kind}: {out}"
        found[kind][level] += 1
        shutil.rmtree(out)
    return found


def test_every_consistent_forgery_is_detected(certified: Path, tmp_path: Path) -> None:
    found = forged(certified, tmp_path, len(KINDS) + 3)
    by_arithmetic = {
        "row: seed",
        "row: parameter",
        "row: exchanged with another",
        "log: an attachment",
        "log: the outcome",
    }
    assert {kind for kind, levels in found.items() if levels["arithmetic"]} == by_arithmetic
    assert found["row: robustness"]["monitor"]
    assert not found["log: a state, and its row"]["monitor"]


@pytest.mark.slow
def test_each_of_many_consistent_forgeries_is_detected(certified: Path, tmp_path: Path) -> None:
    """The table of docs/evidence.md is of 500."""
    cases = int(os.environ.get("SYMAWARE_FORGERIES", str(2 * len(KINDS))))
    found = forged(certified, tmp_path, cases)
    for kind, levels in found.items():
        print(f"| {kind} | " + " | ".join(str(levels[level]) for level in LEVELS) + " |")
    assert sum(levels.total() for levels in found.values()) == cases
