"""Numbers that overflow fail where they are written, without further warnings of NumPy."""

from pathlib import Path

import numpy as np

from symaware_cli.language.build import build
from symaware_cli.language.execution import execute


def test_an_overflow_within_a_run_raises_no_warning(scenarios: Path) -> None:
    """Warnings are errors in these tests, so one would end the run."""
    built = build(scenarios / "hello.yaml", ["run.duration=0.1"])
    seen = []
    built.simulation.events.subscribe("iterating", lambda event: seen.append(np.float64(1e300) * np.float64(1e300)))
    assert execute(built, None).status == "finished"
    assert seen == [np.inf, np.inf]
