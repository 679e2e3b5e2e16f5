"""A real log, written by the real writer, and runs of several processes."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from sample_log import write_sample
from spreading import Spread, written


@pytest.fixture
def sample(tmp_path: Path) -> Path:
    """A finished log of 40 steps in 8 chunks."""
    return write_sample(tmp_path / "sample.mcap")


@pytest.fixture
def spread(tmp_path: Path) -> Iterator[Callable[..., Spread]]:
    """Begin a run that several processes share; all of them are over when the test is."""
    begun = []

    def begin(scenario: Path | dict[str, Any], *arguments: object, folder: str = "spread", **options: Any) -> Spread:
        if isinstance(scenario, dict):
            scenario = written(tmp_path / f"{scenario['name']}.yaml", scenario)
        begun.append(Spread(tmp_path / folder, scenario, *arguments, **options))
        return begun[-1]

    yield begin
    for each in begun:
        each.close()
