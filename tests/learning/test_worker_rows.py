"""Rows in worker processes equal those in one process, byte for byte, and no process outlives its environment."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import worker_tasks
from child_processes import is_running
from gymnasium.vector import AutoresetMode
from learning_scenarios import HEAD_ON, REWARD

import symaware_cli as sa
from symaware_cli.learning.team_vector_environment import ScenarioTeamVectorEnv
from symaware_cli.learning.vector_environment import ScenarioVectorEnv
from symaware_cli.learning.worker_rows import WorkerRows

Rows = ScenarioVectorEnv | ScenarioTeamVectorEnv

#: Episodes end at different steps, and the speed of the robots is noisy.
TASK: dict[str, Any] = {
    "observation": ["state", "goal - position", {"nearest": 2}],
    "reward": [REWARD, {"specification": "apart", "as": "change"}],
    "terminate": "x > 4.9 or y > 1",
    "changes": {
        "agents.robot.model.with.process_noise": [0.5, 0.5, 0.1],
        "run.duration": 0.5,
        "specifications.apart": {"each": "robot", "formula": "always[0, 0.3] nearest > 3"},
    },
}


def result(rows: Rows, steps: int = 14) -> list[bytes]:
    """Return all results of some steps with random actions, and close the environment."""
    random = np.random.default_rng(0)
    observations, infos = rows.reset(seed=3)
    found: list[bytes] = [observations.tobytes(), infos["present"].tobytes()]
    for _ in range(steps):
        *arrays, infos = rows.step(random.uniform(rows.action_space.low, rows.action_space.high))
        found += [each.tobytes() for each in arrays]
        found += [infos[key].tobytes() for key in sorted(infos) if infos[key].dtype != object]
    rows.close()
    return found


def driven(rows: Rows, steps: int = 4, action: float = np.nan) -> None:
    """Make some steps, driven by components or by equal control inputs."""
    for _ in range(steps):
        rows.step(np.full(rows.action_space.shape, action))


#: Initial states for models without a heading.
POINTS = {"agents.robot.state": {"circle": {"radius": 5.0}}}


def processes(rows: Rows) -> list[int]:
    """Return the numbers of the worker processes."""
    source = rows.episodes.source
    assert isinstance(source, WorkerRows)
    return [each.child._process.pid for each in source._workers]


def test_results_do_not_depend_on_the_number_of_processes() -> None:
    expected = result(sa.vector_env(HEAD_ON, 5, "robot", **TASK))
    assert result(sa.vector_env(HEAD_ON, 5, "robot", **TASK, workers=2)) == expected


def test_rows_of_a_physics_world_are_the_same_in_processes() -> None:
    own = {**TASK, "terminate": "x > 99", "changes": {"specifications.apart": TASK["changes"]["specifications.apart"]}}
    own["changes"] |= {"environment": {"use": "pymunk", "with": {"time_step": 0.05}}, "run.duration": 0.5}
    expected = result(sa.vector_env(HEAD_ON, 3, "robot.1", **own))
    rows = sa.vector_env(HEAD_ON, 3, "robot.1", **own, workers=8)
    assert rows.unbatched == "the environment `pymunk` moves one world"
    assert len(processes(rows)) == 3
    assert result(rows) == expected


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "workers", "batched"),
    [
        # All pairs of a mode and rows in batches, with shares of unequal size; then each number of processes.
        *((mode, 3, batched) for mode in AutoresetMode for batched in (True, False)),
        *((AutoresetMode.NEXT_STEP, workers, workers > 1) for workers in (1, 2, 5)),
    ],
)
def test_results_do_not_depend_on_processes_in_any_mode(mode: AutoresetMode, workers: int, batched: bool) -> None:
    own = {**TASK, "autoreset_mode": mode, "batched": batched}
    if mode is AutoresetMode.DISABLED:
        own |= {"terminate": "x > 99", "changes": {**TASK["changes"], "run.duration": 2.0}}
    expected = result(sa.vector_env(HEAD_ON, 5, "robot", **own))
    assert result(sa.vector_env(HEAD_ON, 5, "robot", **own, workers=workers)) == expected


def test_a_function_that_another_process_cannot_import_is_refused() -> None:
    with pytest.raises(sa.LearningError, match="cannot import the function `reward`: define it at the top of a module"):
        sa.vector_env(HEAD_ON, 2, "robot", reward=lambda team: np.zeros(4), workers=2)


def test_a_process_that_dies_is_reported_and_none_is_left() -> None:
    rows = sa.vector_env(HEAD_ON, 3, "robot", reward=worker_tasks.dies, workers=2)
    numbers = processes(rows)
    rows.reset(seed=1)
    with pytest.raises(sa.LearningError, match=r"the worker process of row 0 was killed by SIGKILL"):
        driven(rows)
    assert not any(map(is_running, numbers))
    with pytest.raises(sa.LearningError, match="was killed by SIGKILL"):
        rows.reset(seed=1)


def test_a_process_that_hangs_is_reported_and_killed() -> None:
    rows = sa.vector_env(HEAD_ON, 2, "robot", reward=worker_tasks.hangs, workers=1, timeout=0.3)
    numbers = processes(rows)
    rows.reset(seed=1)
    with pytest.raises(sa.LearningError, match=r"of rows 0 to 1 made no progress for 0\.3 s, and was killed"):
        driven(rows)
    assert not any(map(is_running, numbers))


def test_an_error_in_a_row_is_raised_and_rows_begin_again() -> None:
    rows = sa.vector_env(HEAD_ON, 2, "robot", reward=worker_tasks.fails, workers=1)
    rows.reset(seed=1)
    with pytest.raises(sa.LearningError, match="LookupError: there is no reward") as found:
        driven(rows)
    assert any("worker_tasks.py" in note for note in found.value.__notes__)
    rows.reset(seed=1)
    rows.close()


def test_a_run_that_fails_has_the_error_of_one_process() -> None:
    changes = {"agents.robot.model": {"use": "single-integrator", "with": {"max_speed": 1e15}}}
    found = []
    for workers in (0, 1):
        rows = sa.vector_env(HEAD_ON, 2, "robot", changes={**changes, **POINTS}, workers=workers, batched=False)
        rows.reset(seed=1)
        with pytest.raises(sa.RunFailedError) as error:
            driven(rows, 40, 1e15)
        failed = error.value
        found.append((str(failed), failed.source, failed.plugin, failed.time, failed.run.summary.steps))
        rows.close()
    assert found[0] == found[1]


def test_ctrl_c_ends_all_processes() -> None:
    two = sa.vector_env(HEAD_ON, 2, "robot", workers=2)
    two.reset(seed=1)
    numbers = processes(two)
    assert all(map(is_running, numbers))
    os.kill(numbers[1], signal.SIGSTOP)  # so that there is time for Ctrl-C
    timer = threading.Timer(0.2, signal.pthread_kill, [threading.main_thread().ident, signal.SIGINT])
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        two.step(np.full(two.action_space.shape, np.nan))
    assert not any(map(is_running, numbers))
    with pytest.raises(sa.LearningError, match="were ended by KeyboardInterrupt"):
        two.step(np.full(two.action_space.shape, np.nan))


KILLED = f"""if True:
    import os, signal, symaware_cli as sa
    rows = sa.vector_env({str(HEAD_ON)!r}, 2, "robot", workers=2)
    print(*[each.child._process.pid for each in rows.episodes.source._workers], flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not end children with their parents")
def test_processes_end_with_the_program_and_leave_no_memory() -> None:
    before = set(Path("/dev/shm").iterdir())
    done = subprocess.run([sys.executable, "-c", KILLED], check=False, capture_output=True, text=True)
    assert done.returncode == -signal.SIGKILL
    deadline = time.monotonic() + 20.0
    numbers = [*map(int, done.stdout.split())]
    assert len(numbers) == 2
    while any(map(is_running, numbers)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(is_running, numbers))
    assert set(Path("/dev/shm").iterdir()) <= before


def test_a_negative_number_of_processes_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 0, not -1"):
        sa.vector_env(HEAD_ON, 2, "robot", workers=-1)
