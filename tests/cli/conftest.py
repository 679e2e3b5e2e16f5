"""The command of these tests runs within their process: what they ask is what it says and does, not how it starts."""

import subprocess
from typing import Any

import pytest
from simulating import Command
from typer.testing import CliRunner

from symaware_cli.cli.application import application


@pytest.fixture
def command(process: Command) -> Command:
    """Run `symaware ARGUMENTS` in an empty folder; in a process of its own only if options of one are given.

    What depends on a process takes `process`: terminals, signals, packages that come and go.
    """

    def run(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
        if options:
            return process(*arguments, **options)
        line = [str(argument) for argument in arguments]
        result = CliRunner().invoke(application, line, prog_name="symaware")
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return subprocess.CompletedProcess(["symaware", *line], result.exit_code, result.stdout, result.stderr)

    return run
