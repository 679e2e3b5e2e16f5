"""The conformance kit: assertions that authors of plugins call in their own tests.

A test of a plugin's determinism is one line in any test framework::

    from symaware_cli.testing import assert_repeatable

    def test_my_scenario_can_be_repeated():
        assert_repeatable("scenarios/mine.yaml", overrides=["run.duration=2"])
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from symaware_cli import processor
from symaware_cli.engine import faults_of
from symaware_cli.log import first_difference, open_log
from symaware_cli.log.digest import Digest, digest
from symaware_cli.world import Model

__all__ = ["assert_batchable", "assert_conforming", "assert_repeatable"]


#: The exit status of a run that violates a specification; such a run can be compared like any other.
_VIOLATED = 3


def _surroundings() -> tuple[dict[str, str], dict[str, str]]:
    """The environment variables of the two processes.

    Besides time and memory, the processes differ in the hashes of strings, which determine the order of sets; in the
    addresses of objects, which `id()` returns; and in the processor, as far as it can be emulated.
    """
    common = {name: value for name, value in os.environ.items() if name not in processor.VARIABLES}
    second = {"PYTHONHASHSEED": "2", "PYTHONMALLOC": "malloc", **processor.emulated("x86-64-v3")}
    return common | {"PYTHONHASHSEED": "1"}, common | second


def assert_repeatable(
    scenario: str | os.PathLike[str],
    overrides: Sequence[str] = (),
    *,
    seed: int | None = None,
    timeout: float | None = None,
) -> Digest:
    """Run a scenario twice, in two fresh processes, and compare the logs.

    All channels except /timing must be equal byte for byte. This detects plugins that depend on wall-clock time, on the
    global random state, on the order of a set or on the address of an object: use ``self.random`` and sort instead. The
    second process computes as on a processor of level x86-64-v3, without AVX-512.

    Args:
        scenario: A scenario file, or a log that contains one.
        overrides: Changes as ``path=value``, like those of ``--set``; a shorter ``run.duration`` makes the test faster.
        seed: A seed that replaces the one of the scenario.
        timeout: Greatest wall time of each run [s]; None for no limit.

    Returns:
        The digest of both runs.

    Raises:
        AssertionError: The runs differ (the message names each channel that differs and the first message), or one did
            not finish.
        subprocess.TimeoutExpired: A run took too long.
    """
    with tempfile.TemporaryDirectory() as folder:
        logs = [Path(folder) / f"run-{number}.mcap" for number in (1, 2)]
        # Both at the same time, as nearly all machines have two processor cores.
        with ThreadPoolExecutor() as pool:
            runs = [
                pool.submit(_run, scenario, overrides, seed, log, surroundings, timeout)
                for log, surroundings in zip(logs, _surroundings(), strict=True)
            ]
        for run in runs:
            run.result()
        first, second = (open_log(log) for log in logs)
        result = digest(first)
        differing = result.differences(digest(second))
        if differing:
            where = first_difference(first, second)
            found = "" if where is None else f"; the first difference is {where}"
            raise AssertionError(f"two runs of {os.fspath(scenario)} differ in {', '.join(differing)}{found}")
        return result


def assert_batchable(scenario: str | os.PathLike[str], overrides: Sequence[str] = ()) -> None:
    """Run a scenario in batches of several sizes, and compare each run with the same run made alone.

    The true states, the control inputs and all metrics must be equal to the bit. This detects components, models and
    worlds that declare ``batchable = True`` although the rows of a run depend on the rows of other runs or on the
    number of rows, as in reductions across rows and in BLAS.

    Args:
        scenario: A scenario file.
        overrides: Changes as ``path=value``; a shorter ``run.duration`` makes the test faster.

    Raises:
        AssertionError: A run differs, or the scenario cannot be batched; the message names the run or the reason.
        ScenarioError: The scenario has problems.
    """
    from symaware_cli.studies import differing_runs

    problem = differing_runs(Path(scenario), overrides)
    if problem is not None:
        raise AssertionError(f"{os.fspath(scenario)}: {problem}")


def assert_conforming(model: Model, state: Sequence[float] | None = None) -> None:
    """Check the shapes and types of a model's results: rates, bounds, positions, velocities, Jacobians.

    The same faults make a scenario invalid.

    Args:
        model: The model.
        state: The state at which to evaluate it, in the model's order; zeros by default.

    Raises:
        AssertionError: A result has another shape or type; the message has a line for each fault.
    """
    faults = list(faults_of(model, None if state is None else np.asarray(state, float)))
    if faults:
        raise AssertionError("".join(f"the model {fault}\n" for fault in faults).rstrip())


def _run(
    scenario: str | os.PathLike[str],
    overrides: Sequence[str],
    seed: int | None,
    log: Path,
    surroundings: dict[str, str],
    timeout: float | None,
) -> None:
    line = [sys.executable, "-P", "-m", "symaware_cli", "run", os.fspath(scenario), "--quiet", "--output", str(log)]
    line += [word for override in overrides for word in ("--set", override)]
    line += [] if seed is None else ["--seed", str(seed)]
    done = subprocess.run(
        line, env=surroundings, stdin=subprocess.DEVNULL, capture_output=True, timeout=timeout, check=False
    )
    if done.returncode not in (0, _VIOLATED):
        said = done.stderr.decode(errors="replace").strip()
        raise AssertionError(f"{os.fspath(scenario)} did not finish, but exited with {done.returncode}: {said}")
