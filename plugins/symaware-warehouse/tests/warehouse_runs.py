"""Runs: scenarios of the package, run by the command line and read from their logs."""

import atexit
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from symaware_cli import Log, open_log

PACKAGE = Path(__file__).parent.parent
SCENARIOS = PACKAGE / "scenarios"

_FOLDER = TemporaryDirectory()
atexit.register(_FOLDER.cleanup)


def command(*arguments: object) -> "subprocess.CompletedProcess[str]":
    """Run a verb of the command line."""
    line = [sys.executable, "-P", "-m", "symaware_cli", *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, timeout=600, check=False)


@cache
def run(scenario: str, *overrides: str) -> Log:
    """Run a scenario of the package, once for the same values."""
    path = Path(_FOLDER.name) / f"{abs(hash((scenario, overrides)))}.mcap"
    sets = [word for override in overrides for word in ("--set", override)]
    done = command("run", SCENARIOS / scenario, "--quiet", "--output", path, *sets)
    assert done.returncode in (0, 3), done.stderr
    return open_log(path)
