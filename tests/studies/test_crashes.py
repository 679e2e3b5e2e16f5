"""Processes are killed at random times, and runs fail or hang: at most the row of the current run is lost."""

from __future__ import annotations

import multiprocessing
import os
import random
import signal
import sqlite3
import subprocess
import time
from contextlib import closing
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import pytest
from simulating import COMMAND
from sweeping import children, rows, symaware, table_digest, tiny

from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.request import SweepRequest
from symaware_cli.studies.session import conduct
from symaware_cli.studies.sweep_source import read_sweep

_RUNS = 200


def created(folder: Path, scenario: Path, runs: int, **options: object) -> Path:
    """Create the folder of a sweep without executing runs."""
    request = SweepRequest(over=["agents.robot.count=1,2"], entries={"runs": runs // 2, **options})
    return SweepFolder.created(folder, read_sweep(scenario, request)).path


def resume(folder: Path, jobs: int, batch: int | None = 1) -> None:
    conduct(SweepFolder.opened(folder), jobs, batch=batch, retry_lost=True)


def driver(folder: Path, jobs: int, batch: int | None = 1) -> ForkServerProcess:
    """Resume a sweep in a separate process that has already imported everything."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["symaware_cli.studies.session", "symaware_cli.studies.runner", "pyarrow.parquet"])
    process = context.Process(target=resume, args=(folder, jobs, batch))
    process.start()
    return process


def made(folder: Path) -> int:
    """Return the number of committed rows."""
    with closing(sqlite3.connect(folder / "journal.sqlite")) as journal:
        if not journal.execute("SELECT name FROM sqlite_master WHERE name = 'runs'").fetchone():
            return 0
        return int(journal.execute("SELECT count(*) FROM runs").fetchone()[0])


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The scenario, and the digest of the table of an uninterrupted sweep."""
    folder = tmp_path_factory.mktemp("unbroken")
    scenario = tiny(folder)
    resume(created(folder / "out", scenario, _RUNS), 0)
    return scenario, table_digest(folder / "out")


def broken(folder: Path, scenario: Path, kills: int, jobs: tuple[int, ...], seed: int) -> None:
    """Repeatedly kill the process that resumes a sweep, or one of its workers, then resume the sweep to its end."""
    chance = random.Random(seed)
    created(folder, scenario, _RUNS)
    for _ in range(kills):
        process = driver(folder, chance.choice(jobs), chance.choice((1, 3, 10)))
        time.sleep(chance.uniform(0.0, 1.0))
        assert process.pid is not None
        workers = children(process.pid)
        if workers and chance.random() < 0.5:
            os.kill(chance.choice(workers), signal.SIGKILL)
            time.sleep(chance.uniform(0.0, 0.5))
        process.kill()
        process.join()
    for _ in range(3):
        resume(folder, 0)


def test_the_table_after_20_kills_equals_that_of_an_uninterrupted_sweep(
    unbroken: tuple[Path, str], tmp_path: Path
) -> None:
    scenario, digest = unbroken
    broken(tmp_path / "out", scenario, 20, (0, 0, 0, 1), seed=1)
    assert [row["index"] for row in rows(tmp_path / "out")] == [*range(_RUNS)]
    assert table_digest(tmp_path / "out") == digest


@pytest.mark.slow
def test_the_table_after_40_kills_equals_that_of_an_uninterrupted_sweep(
    unbroken: tuple[Path, str], tmp_path: Path
) -> None:
    scenario, digest = unbroken
    # use 10 for 200 kills.
    for seed in range(int(os.environ.get("SYMAWARE_KILL_SEEDS", "2"))):
        broken(tmp_path / f"{seed}", scenario, 20, (0, 1, 2), seed)
        assert table_digest(tmp_path / f"{seed}") == digest


def test_a_killed_worker_costs_one_row_and_is_replaced(unbroken: tuple[Path, str], tmp_path: Path) -> None:
    scenario, digest = unbroken
    out = created(tmp_path / "out", scenario, _RUNS)
    process = driver(out, 1)
    assert process.pid is not None
    while made(out) < 10:
        time.sleep(0.01)
    (worker,) = children(process.pid)
    os.kill(worker, signal.SIGKILL)
    process.join(120)
    lost = [row for row in rows(out) if row["state"] != "done"]
    assert [(row["state"], row["error"]) for row in lost] == [("lost", "the worker process was killed by SIGKILL")]
    resume(out, 0)
    assert table_digest(out) == digest


def test_workers_end_with_their_parent_process(unbroken: tuple[Path, str], tmp_path: Path) -> None:
    out = created(tmp_path / "out", unbroken[0], _RUNS)
    process = driver(out, 2)
    assert process.pid is not None
    while not (workers := children(process.pid)):
        time.sleep(0.01)
    process.kill()
    process.join()
    patience = time.monotonic() + 30
    while any(Path(f"/proc/{pid}/stat").exists() for pid in workers):
        assert time.monotonic() < patience
        time.sleep(0.02)


def test_a_sweep_ended_by_ctrl_c_can_be_resumed_immediately(unbroken: tuple[Path, str], tmp_path: Path) -> None:
    scenario, digest = unbroken
    out = created(tmp_path / "out", scenario, _RUNS)
    process = subprocess.Popen(
        [*COMMAND, "resume", str(out), "--jobs", "0", "--batch", "off"], stdout=subprocess.PIPE, text=True
    )
    while not (out / "journal.sqlite").exists() or made(out) < 10:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "interrupted" in said
    assert 10 <= len(rows(out)) < _RUNS
    symaware("resume", out, "--jobs", 0)
    assert table_digest(out) == digest


def test_two_processes_cannot_work_on_one_sweep(unbroken: tuple[Path, str], tmp_path: Path) -> None:
    out = created(tmp_path / "out", unbroken[0], _RUNS)
    with SweepFolder.opened(out).locked():
        assert "another process is at work" in symaware("resume", out, status=2)


_THINKER = """\
symaware: 1
name: thinkers
run: {duration: 0.5}
environment: {use: kinematic, with: {time_step: 0.1}}
agents:
  robot:
    model: {use: single-integrator}
    knowledge: {goal: [3, 0]}
    components:
      sense: {use: perception.self}
      think: {use: doubles.thinker}
"""


def variant(name: str, **parameters: object) -> list[str]:
    changes = [f"agents.robot.components.think.with.{key}: {value}" for key, value in parameters.items()]
    return ["--with", f"variants.{name}={{{', '.join(changes)}}}"]


def test_a_run_that_fails_hangs_or_kills_its_process_costs_only_its_own_row(doubles: Path, tmp_path: Path) -> None:
    scenario, out = tmp_path / "thinkers.yaml", tmp_path / "out"
    scenario.write_text(_THINKER)
    ways = [variant(how, how=how, at=0.2) for how in ("raise", "kill", "hang", "nan")]
    options = [
        *variant("fine"),
        *(word for way in ways for word in way),
        "--with",
        "timeout=2",
        "--runs",
        2,
        "--jobs",
        1,
    ]
    symaware("sweep", scenario, "-o", out, *options, "--with", "timeout=2", "--with", "keep=failed", status=1)
    found = {(row["variant"], row["replicate"]): (row["state"], row["error"] or "") for row in rows(out)}
    for replicate in (0, 1):
        assert found["fine", replicate] == ("done", "")
        assert found["raise", replicate][0] == "failed"
        assert "agents.robot.think" in found["raise", replicate][1]
        assert "on purpose" in found["raise", replicate][1]
        assert found["kill", replicate] == ("lost", "the worker process was killed by SIGKILL")
        assert found["hang", replicate] == ("lost", "it did not end within 2 s")
        assert found["nan", replicate][0] == "failed"
    assert len(list((out / "logs").iterdir())) == 4  # the logs of the failed runs
    # Failed runs stay failed; lost runs are repeated.
    symaware("resume", out, "--jobs", 0, status=1)
    before = [row for row in rows(out) if row["state"] != "lost"]
    assert len(before) == 6


def test_a_worker_that_holds_the_interpreter_lock_is_killed(doubles: Path, tmp_path: Path) -> None:
    scenario, out = tmp_path / "holder.yaml", tmp_path / "out"
    scenario.write_text(_THINKER.replace("doubles.thinker", "doubles.holder"))
    options = ["--over", "agents.robot.components.think.with.duration=0,1000", "--with", "timeout=0.2", "--jobs", 1]
    symaware("sweep", scenario, "-o", out, *options, status=1)
    assert [row["state"] for row in rows(out)] == ["done", "lost"]


def test_fail_fast_ends_a_sweep_at_the_first_failure(doubles: Path, tmp_path: Path) -> None:
    scenario, out = tmp_path / "thinkers.yaml", tmp_path / "out"
    scenario.write_text(_THINKER)
    fails = variant("raise", how="raise", at=0.2)
    options = ["--runs", 5, "--jobs", 0, "--fail-fast"]
    said = symaware("sweep", scenario, "-o", out, *variant("fine"), *fails, *options, status=1)
    assert "on purpose" in said
    assert [row["state"] for row in rows(out)] == ["done", "failed"]
