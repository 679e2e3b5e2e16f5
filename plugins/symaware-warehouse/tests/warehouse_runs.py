"""Runs: scenarios of the package, run by the command line and read from their logs."""

import atexit
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from simulating import in_process as command

from symaware_cli import Log, open_log

PACKAGE = Path(__file__).parent.parent
SCENARIOS = PACKAGE / "scenarios"

_FOLDER = TemporaryDirectory()
atexit.register(_FOLDER.cleanup)


@cache
def run(scenario: str, *overrides: str) -> Log:
    """Run a scenario of the package, once for the same values."""
    path = Path(_FOLDER.name) / f"{abs(hash((scenario, overrides)))}.mcap"
    sets = [word for override in overrides for word in ("--set", override)]
    done = command("run", SCENARIOS / scenario, "--quiet", "--output", path, *sets)
    assert done.returncode in (0, 3), done.stderr
    return open_log(path)
