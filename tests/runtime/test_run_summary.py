"""The figures of the summary of a run."""

from pathlib import Path

import pytest

from symaware_cli.runtime.run_summary import Observer
from symaware_cli.scenario.build import build


@pytest.mark.parametrize("is_member", [False, True])
def test_distances_are_measured_by_the_process_that_steps_the_world(scenarios: Path, is_member: bool) -> None:
    observer = Observer(build(scenarios / "hello.yaml").simulation, is_member=is_member)
    observer.sample(0)
    assert (observer.minimum_separation is None) == is_member
