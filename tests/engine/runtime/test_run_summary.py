"""The figures of the summary of a run."""

from pathlib import Path

import pytest
from simulating import Team, simulate

from symaware_cli.core import Component, Level
from symaware_cli.engine.runtime.run_summary import Observer
from symaware_cli.language.build import build


@pytest.mark.parametrize("is_member", [False, True])
def test_distances_are_measured_by_the_process_that_steps_the_world(scenarios: Path, is_member: bool) -> None:
    observer = Observer(build(scenarios / "hello.yaml").simulation, is_member=is_member)
    observer.sample(0)
    assert (observer.minimum_separation is None) == is_member


@pytest.mark.parametrize("level", [Level.INFO, Level.WARNING, Level.ERROR])
def test_an_error_that_an_agent_reports_is_counted_and_makes_the_run_fall_short(level: Level) -> None:
    class Reporter(Component):
        def _compute(self) -> None:
            return None

        def _update(self, value: None) -> None:
            self.emit("too-close", "somebody is near", level=level)

    summary = simulate({"a": Team(count=2, components={"report": Reporter})}, steps=3)
    assert summary.status == "finished"
    counts = {"too-close": 6}
    assert summary.warnings == (counts if level is Level.WARNING else {})
    assert summary.errors == (counts if level is Level.ERROR else {})
    assert summary.falls_short == (level is Level.ERROR)
