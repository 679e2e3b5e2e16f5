"""Sweeps on Ray: the table does not depend on where runs are executed or on which processes die."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from ray_nodes import RayNodes, ray_nodes
from simulating import COMMAND
from sweeping import rows, symaware, table_digest, tiny

import symaware_cli

pytest.importorskip("ray", reason="Ray is not installed")

# All of these tests run in one process, to share one cluster.
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("ray"), pytest.mark.filterwarnings("default")]

#: The message of Ray when it ends a process whose task answered while being cancelled, and its maximum frequency.
_DEFECT, _ATTEMPTS = "You have likely discovered a bug in Ray", 4


@pytest.fixture(scope="module")
def nodes() -> Iterator[RayNodes]:
    with ray_nodes() as started:
        yield started


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A scenario, and the digest of the table of 300 of its runs."""
    folder = tmp_path_factory.mktemp("expected")
    scenario = tiny(folder)
    symaware("sweep", scenario, "-o", folder / "out", "--runs", 300, "--jobs", 0)
    return scenario, table_digest(folder / "out")


@contextmanager
def started(scenario: Path, out: Path, nodes: RayNodes) -> Iterator[subprocess.Popen[str]]:
    """Start a sweep of 300 runs, one by one."""
    options = ["--runs", "300", "--batch", "off", "--on", f"ray:{nodes.address}"]
    line = [*COMMAND, "sweep", str(scenario), "-o", str(out), *options]
    sweep = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield sweep
    finally:
        sweep.kill()
        sweep.wait()


def workers() -> dict[int, int]:
    """Return the processes that execute runs, each with the Ray worker that started it."""
    lines = subprocess.run(["ps", "-wweo", "pid=,ppid=,args="], capture_output=True, text=True).stdout.splitlines()
    parents = {int(pid): int(parent) for pid, parent, *_ in map(str.split, lines)}
    mine = {int(line.split()[0]) for line in lines if "studies.pool_worker" in line}
    return {pid: parents[pid] for pid in mine if _descends(pid, parents)}


def _descends(pid: int, parents: dict[int, int]) -> bool:
    while pid in parents and pid != os.getpid():
        pid = parents[pid]
    return pid == os.getpid()


def awaited(count: int) -> dict[int, int]:
    patience = time.monotonic() + 300
    while len(found := workers()) < count:
        assert time.monotonic() < patience, found
        time.sleep(0.1)
    return found


def assert_soon_empty(remaining: Callable[[], Collection[object]]) -> None:
    """Wait, because processes need a moment to end, and Ray's own ones to remove what a block left."""
    patience = time.monotonic() + 20
    while found := remaining():
        assert time.monotonic() < patience, found
        time.sleep(0.1)


def assert_no_workers_remain() -> None:
    assert_soon_empty(workers)


def test_one_node_and_two_nodes_give_the_table_of_one_process(
    nodes: RayNodes, expected: tuple[Path, str], tmp_path: Path
) -> None:
    scenario, digest = expected
    said = symaware("sweep", scenario, "-o", tmp_path / "one", "--runs", 300, "--on", f"ray:{nodes.address}")
    assert said.startswith(f"{tmp_path / 'one'}: finished; 300 of 300 runs done")
    second = nodes.add()
    try:
        symaware_cli.sweep(scenario, tmp_path / "two", runs=300, batch=1, on=f"ray:{nodes.address}")
    finally:
        nodes.kill(second)
    assert table_digest(tmp_path / "one") == table_digest(tmp_path / "two") == digest
    assert_no_workers_remain()


def test_killing_a_worker_and_a_node_loses_no_rows(nodes: RayNodes, expected: tuple[Path, str], tmp_path: Path) -> None:
    scenario, digest = expected
    second = nodes.add()
    with started(scenario, tmp_path / "out", nodes) as sweep:
        try:
            os.kill(next(iter(awaited(2).values())), signal.SIGKILL)  # a worker of Ray
            time.sleep(1.0)
        finally:
            nodes.kill(second)
        said, _ = sweep.communicate(timeout=300)
    assert sweep.returncode == 0, said
    assert table_digest(tmp_path / "out") == digest


def test_ctrl_c_leaves_no_processes_behind(nodes: RayNodes, expected: tuple[Path, str], tmp_path: Path) -> None:
    scenario, digest = expected
    for number in range(_ATTEMPTS):
        out, before = tmp_path / str(number), {*nodes.folder.iterdir()}
        with started(scenario, out, nodes) as sweep:
            awaited(1)
            time.sleep(1.0)
            sweep.send_signal(signal.SIGINT)
            said, _ = sweep.communicate(timeout=60)
        if _DEFECT not in said:
            break
        assert_no_workers_remain()
    assert sweep.returncode == 130, said
    assert_no_workers_remain()
    assert_soon_empty(lambda: {*nodes.folder.iterdir()} - before)
    symaware("resume", out, "--jobs", 0)
    assert table_digest(out) == digest


def test_kept_logs_are_returned(nodes: RayNodes, expected: tuple[Path, str], tmp_path: Path) -> None:
    options: list[Any] = ["--runs", 4, "--with", "keep=worst:2"]
    symaware("sweep", expected[0], "-o", tmp_path / "here", *options, "--jobs", 0)
    symaware("sweep", expected[0], "-o", tmp_path / "there", *options, "--on", f"ray:{nodes.address}")
    here, there = ({file.name for file in (tmp_path / name / "logs").iterdir()} for name in ("here", "there"))
    assert len(here) == 2
    assert here == there


def test_a_node_with_a_different_file_is_rejected(nodes: RayNodes, expected: tuple[Path, str], tmp_path: Path) -> None:
    package = Path(symaware_cli.__file__).parent
    copy = tmp_path / "other" / package.name
    shutil.copytree(package, copy, ignore=shutil.ignore_patterns("__pycache__"))
    with open(copy / "core" / "agent.py", "a") as file:
        file.write("# edited\n")
    second = nodes.add(PYTHONPATH=str(copy.parent))
    try:
        out = tmp_path / "out"
        said = symaware(
            "sweep", expected[0], "-o", out, "--runs", 40, "--batch", "off", "--on", f"ray:{nodes.address}", status=2
        )
    finally:
        nodes.kill(second)
    assert "other code" in said
    assert "symaware-cli: symaware_cli/core/agent.py is another file there" in said
    symaware("resume", out, "--on", f"ray:{nodes.address}")
    assert len(rows(out)) == 40
