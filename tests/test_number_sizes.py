"""However large a number of a scenario is, ten steps need little memory, or the scenario is refused at a place."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from fuzzing.campaign import replay
from fuzzing.targets.numbers import FORMULAS, SIZES, fields, with_formula


def accepted(scenarios: Sequence[dict[str, Any]], folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Run scenarios in a child with limited memory and one thread; return which are not refused."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.setenv(name, "1")
    files = []
    for number, scenario in enumerate(scenarios):
        files.append(folder / f"{number}.json")
        files[-1].write_text(json.dumps(scenario))
    results = [(path.read_text(), result) for path, result in replay("numbers", files)]
    assert [(text, result.found) for text, result in results if result.found] == []
    return ["refused" not in result.tally for _, result in results]


def test_a_window_of_any_length_needs_little_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenarios = [with_formula(formula, SIZES[-1]) for formula in FORMULAS[::3]]
    assert sum(accepted(scenarios, tmp_path, monkeypatch)) > len(scenarios) / 2


@pytest.mark.slow
def test_no_window_of_a_formula_needs_much_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenarios = [with_formula(formula, size) for size in SIZES for formula in FORMULAS]
    assert sum(accepted(scenarios, tmp_path, monkeypatch)) > len(scenarios) / 2


@pytest.mark.slow
def test_no_number_of_the_language_needs_much_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each field has the largest number that it accepts: where that needs little memory, a smaller one does, too."""
    least, middle, most = sorted(SIZES)
    by_size = {size: list(fields(size)) for size in SIZES}
    assert len(set(map(len, by_size.values()))) == 1

    def split(size: int, places: Sequence[int]) -> tuple[list[int], list[int]]:
        """The places where a number of that size is accepted, and those where it is refused."""
        found = accepted([by_size[size][place] for place in places], tmp_path, monkeypatch)
        chosen = [place for place, is_accepted in zip(places, found, strict=True) if is_accepted]
        return chosen, [place for place in places if place not in set(chosen)]

    large, others = split(most, range(len(by_size[most])))
    # Most are refused whatever the number is: only those that accept the least have to be asked about the middle.
    small, _ = split(least, others)
    medium, _ = split(middle, small)
    assert large
    assert medium
    assert small
    assert len(large) + len(small) > 300
