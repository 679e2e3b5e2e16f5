"""The part of a sweep on Ray nodes: a Ray worker passes blocks of runs on to a worker process of its own.

Ray is thus absent from the processes of runs, whose environment is set before their Python starts, and a run that
crashes or hangs costs only its own row. No code is transferred: Ray refers to the function by name.
"""

from __future__ import annotations

import shutil
import socket
import tempfile
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from symaware_cli.plugin_files import trusted_copy
from symaware_cli.studies.executor import Blocks
from symaware_cli.studies.folder import SweepWork
from symaware_cli.studies.identity import CodeIdentity
from symaware_cli.studies.row import Row
from symaware_cli.studies.sweep_files import LOGS, SCENARIO
from symaware_cli.studies.worker_pool import CodeDifferenceError, WorkerPool, WorkerPoolError


@dataclass(frozen=True, slots=True)
class SweepSetup:
    """The description of a sweep for a node; plain data.

    Attributes:
        key: Distinguishes the sweep from others that the same Ray worker may serve.
        files: The files of its folder that determine the rows, by name.
        timeout: Wall time after which a run is abandoned [s].
        batch: See `Runner`.
        code: The required code identity of the node.
        own_code: The SHA-256 of each file of code of the scenario, by its path: the node has them, and trusts them.
    """

    key: str
    files: Mapping[str, bytes]
    timeout: float | None
    batch: int | None
    code: Mapping[str, Any]
    own_code: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class BlockAnswer:
    """The results of a block, or the reason why there are none.

    Attributes:
        rows: Its rows.
        logs: The logs of its runs by name, if recorded.
        trouble: Why there are no rows; None on success.
    """

    rows: Sequence[Row] = ()
    logs: Mapping[str, bytes] = field(default_factory=dict)
    trouble: str | None = None


class _NodeWorker:
    """The worker process of this Ray worker.

    A copy of the sweep's folder exists only while a block is executed, because Ray ends its workers without letting
    them clean up.
    """

    def __init__(self, setup: SweepSetup) -> None:
        self.key = setup.key
        self._setup = setup
        self._folder = Path(tempfile.gettempdir(), f"symaware-sweep-{uuid.uuid4().hex}")
        work = SweepWork(str(self._folder), setup.batch)
        self._pool = WorkerPool(work, 1, setup.timeout, CodeIdentity(**setup.code))

    def answer(self, indices: Sequence[int], is_recorded: bool) -> BlockAnswer:
        with self._copied() as logs:
            rows = list(self._pool.results(Blocks(indices, len(indices), is_recorded=is_recorded, run_time=0.0)))
            return BlockAnswer(rows, {file.name: file.read_bytes() for file in logs.iterdir()})

    def close(self) -> None:
        self._pool.close()

    @contextmanager
    def _copied(self) -> Iterator[Path]:
        """Provide a copy of the sweep's folder for the duration of a block; yields the folder of its logs."""
        own = self._setup.own_code and trusted_copy(self._setup.own_code)
        if own is None:
            raise CodeDifferenceError(
                f"{', '.join(self._setup.own_code)} of this sweep is not trusted on this node, or differs: "
                f"symaware trust FOLDER on it"
            )
        code = {f"{SCENARIO}/{name}": content for name, content in (own or {}).items()}
        self._folder.mkdir(mode=0o700)
        try:
            for name, content in {**self._setup.files, **code}.items():
                file = self._folder / name
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(content)
            logs = self._folder / LOGS
            logs.mkdir()
            yield logs
        finally:
            shutil.rmtree(self._folder)


_worker: _NodeWorker | None = None


def answer(setup: SweepSetup, indices: Sequence[int], is_recorded: bool) -> BlockAnswer:
    """Execute a block of runs; the worker process is kept for the next block."""
    global _worker
    if _worker is None or _worker.key != setup.key:
        close()
        _worker = _NodeWorker(setup)
    try:
        return _worker.answer(indices, is_recorded)
    except (CodeDifferenceError, WorkerPoolError) as error:
        close()
        return BlockAnswer(trouble=f"{socket.gethostname()}: {error}")
    except BaseException:  # such as the cancellation of the task
        close()
        raise


def close() -> None:
    """End the worker process."""
    global _worker
    if _worker is not None:
        _worker.close()
        _worker = None
