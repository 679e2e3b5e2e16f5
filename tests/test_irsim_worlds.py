"""The worlds of IR-SIM that `benchmarks/irsim_scenarios` has as scenarios."""

from __future__ import annotations

from pathlib import Path

import pytest

from symaware_cli.language.build import build

WORLDS = sorted((Path(__file__).parents[1] / "benchmarks" / "irsim_scenarios").glob("*.yaml"))


def test_there_are_twenty() -> None:
    assert len(WORLDS) == 20


@pytest.mark.parametrize("path", WORLDS, ids=lambda path: path.stem)
def test_a_world_is_a_sound_scenario_without_warnings(path: Path) -> None:
    built = build(path)
    assert built.document.name == path.stem
    assert not built.find_warnings()
