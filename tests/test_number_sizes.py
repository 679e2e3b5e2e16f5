"""However large a number of a scenario is, ten steps need little memory, or the scenario is refused at a place."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from fuzzing.campaign import replay
from fuzzing.targets.numbers import FORMULAS, SIZES, cases, with_formula


def tried(scenarios: Sequence[dict[str, Any]], folder: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """Run scenarios in a child with limited memory and one thread; return how many are not refused."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.setenv(name, "1")
    files = []
    for number, scenario in enumerate(scenarios):
        files.append(folder / f"{number}.json")
        files[-1].write_text(json.dumps(scenario))
    results = [(path.read_text(), result) for path, result in replay("numbers", files)]
    assert [(text, result.found) for text, result in results if result.found] == []
    return sum("refused" not in result.tally for _, result in results)


def test_a_window_of_any_length_needs_little_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenarios = [with_formula(formula, SIZES[-1]) for formula in FORMULAS[::3]]
    assert tried(scenarios, tmp_path, monkeypatch) > len(scenarios) / 2


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
def test_no_number_of_the_language_needs_much_memory(
    size: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenarios = list(cases(size))
    assert tried(scenarios, tmp_path, monkeypatch) > 100
