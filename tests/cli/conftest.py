"""The command of these tests runs within their process: what they ask is what it says and does, not how it starts."""

import subprocess
from typing import Any

import pytest
from simulating import Command, in_process


@pytest.fixture
def command(process: Command) -> Command:
    """Run `symaware ARGUMENTS` in an empty folder; in a process of its own only if options of one are given.

    What depends on a process takes `process`: terminals, signals, packages that come and go.
    """

    def run(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
        if options:
            return process(*arguments, **options)
        return in_process(*arguments)

    return run
