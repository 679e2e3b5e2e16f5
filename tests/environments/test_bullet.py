"""The engine of the spatial world, and what it prints."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_the_engine_can_be_had_where_there_is_nothing_to_print_on(closed: str) -> None:
    program = "import sys; from symaware_cli.environments.bullet import Client; Client(False).close(); sys.exit(7)"
    line = ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-P", "-c", program]
    assert subprocess.run(line, capture_output=True, timeout=60, check=False).returncode == 7
