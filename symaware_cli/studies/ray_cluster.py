"""The executor `ray`: blocks of runs are tasks on an existing Ray cluster, and only this process receives their rows.

Reasons: docs/decisions/0034-ray.md
"""

from __future__ import annotations

import hashlib
import os
import signal
import socket
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from symaware_cli.studies.executor import Block, Blocks, Executor
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.identity import CodeIdentity
from symaware_cli.studies.node_worker import BlockAnswer, SweepSetup, answer
from symaware_cli.studies.row import Row
from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.sweep_execution import SweepExecution, SweepTask
from symaware_cli.studies.sweep_files import IDENTITY, SCENARIO, SWEEP

#: The suffix of files of code, which is compared with that of nodes and never sent.
_OF_CODE = ".py"

#: Timeouts for the answer of a cluster's head and for a cluster without any processor [s].
_REACHED_WITHIN, _WITHOUT_PROCESSORS = 5.0, 60.0

#: The time that workers have to clean up when a sweep is interrupted [s].
_FAREWELL = 5.0

#: The maximum number of consecutive lost tasks per running task.
_PATIENCE = 3


class RayExecution(SweepExecution):
    """Runs on a Ray cluster; the address is ``HOST:PORT`` of its head, or ``auto``."""

    def executor(self, task: SweepTask) -> AbstractContextManager[Executor[Row]]:
        """Return an executor of Ray tasks."""
        return closing(RayCluster(task.folder, task.address or "auto", task.jobs, task.batch))


class RayCluster:
    """An `Executor` of Ray tasks."""

    def __init__(self, folder: SweepFolder, address: str, most: int = 0, batch: int | None = None) -> None:
        """Connect to a cluster.

        Args:
            folder: The folder of the sweep.
            address: The address of the cluster, as Ray takes it: ``HOST:PORT``, or ``auto``. If this process is already
                connected to a cluster, that cluster is used.
            most: The maximum number of concurrent tasks; 0 for the number of processors of the cluster.
            batch: See `Runner`.

        Raises:
            SweepError: Ray is not installed, or there is no cluster.
        """
        _check(address)
        # Determined before Ray is imported: only this code produces rows.
        code = CodeIdentity.of_this_process().to_json()
        setup = SweepSetup(
            uuid.uuid4().hex,
            files_of(folder.path),
            folder.plan.document.timeout,
            batch,
            code,
            own_code_of(folder.path),
        )
        self._ray = _imported()
        self._is_mine = not self._ray.is_initialized()
        if self._is_mine:
            _connect(self._ray, address)
        self._logs = folder.logs
        self._most = most
        # Ray does not retry lost tasks: their blocks are submitted again here, so that no run has two rows.
        self._answer = self._ray.remote(num_cpus=1, max_retries=0)(answer)
        self._setup = self._ray.put(setup)
        self._tasks: dict[Any, Block] = {}
        self._lost = 0

    def results(self, blocks: Blocks) -> Iterator[Row]:
        """See `Executor`.

        Raises:
            SweepError: A node has different code, or the cluster completes no runs.
        """
        seen = time.monotonic()
        while True:
            count = int(self._ray.cluster_resources().get("CPU", 0))
            seen = time.monotonic() if count else seen
            if time.monotonic() - seen > _WITHOUT_PROCESSORS:
                raise SweepError("the cluster has no processors left; the sweep can be resumed")
            self._submit(blocks, self._most or max(1, count))
            if not self._tasks:
                return
            done, _ = self._ray.wait(list(self._tasks), timeout=_REACHED_WITHIN)
            for task in done:
                yield from self._answered(task, self._tasks.pop(task), blocks)

    def close(self) -> None:
        """Cancel all tasks and disconnect from the cluster, which ends the workers of this sweep."""
        tasks = list(self._tasks)
        self._tasks.clear()
        with suppress(self._ray.exceptions.RayError):
            for task in tasks:
                self._ray.cancel(task)
            if tasks:
                self._ray.wait(tasks, num_returns=len(tasks), timeout=_FAREWELL)
        if self._is_mine:
            self._ray.shutdown()

    def _submit(self, blocks: Blocks, count: int) -> None:
        while len(self._tasks) < count:
            block = blocks.take(count)
            if block is None:
                return
            self._tasks[self._answer.remote(self._setup, block.indices, block.is_recorded)] = block

    def _answered(self, task: Any, block: Block, blocks: Blocks) -> Iterator[Row]:
        try:
            answered: BlockAnswer = self._ray.get(task)
        except self._ray.exceptions.RayTaskError as error:
            raise SweepError(f"a node cannot make runs: {error.cause!r}") from error
        except self._ray.exceptions.RayError as error:
            # Its worker or node is gone, and all rows of the block with it.
            blocks.give_back(block.indices)
            self._lost += 1
            if self._lost > _PATIENCE * (len(self._tasks) + 1):
                reason = str(error).strip().partition("\n")[0]
                raise SweepError(f"the cluster lost {self._lost} tasks one after the other: {reason}") from error
            return
        if answered.trouble is not None:
            raise SweepError(answered.trouble)
        self._lost = 0
        for name, content in answered.logs.items():
            draft = self._logs / f".{name}.{os.getpid()}"
            draft.write_bytes(content)
            os.replace(draft, self._logs / name)
        for row in answered.rows:
            blocks.learn(row.wall_time)
            yield row


def files_of(folder: Path) -> dict[str, bytes]:
    """Return the files of a sweep's folder that determine its rows, without the scenario's own code."""
    found = [folder / SWEEP, folder / IDENTITY, *(each for each in (folder / SCENARIO).rglob("*") if each.is_file())]
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in sorted(found) if file.suffix != _OF_CODE}


def own_code_of(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each file of code of a sweep's scenario, by its path relative to the scenario's folder."""
    found = sorted((folder / SCENARIO).rglob(f"*{_OF_CODE}"))
    return {
        file.relative_to(folder / SCENARIO).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest() for file in found
    }


def _imported() -> Any:
    """Ray.

    Raises:
        SweepError: It is not installed.
    """
    try:
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
        with _signals_kept():
            import ray
    except ImportError:
        raise SweepError(
            "a cluster needs the module `ray`, which is not installed: pip install 'symaware-cli[ray]'"
        ) from None
    return ray


def _check(address: str) -> None:
    """Check that something listens at an address, because Ray itself would retry for minutes.

    Raises:
        SweepError: Nothing listens there, or the address is invalid.
    """
    if address == "auto":
        return
    host, _, port = address.rpartition(":")
    if not (host and port.isdecimal() and int(port) < 1 << 16):
        raise SweepError(f"the address of a Ray cluster is HOST:PORT or auto, not `{address}`")
    host = host.strip("[]")
    try:
        _reach(host, int(port))
    except OSError as error:
        raise SweepError(_unreachable(address, error)) from error
    if host in ("127.0.0.1", "localhost", "::1"):
        # Ray replaces a loopback address by that of this machine in its network, where a cluster may not listen. A
        # variable that it reads when imported makes it keep the loopback address.
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
                other.connect(("192.0.2.1", 1))  # sends nothing
                _reach(other.getsockname()[0], int(port))
        except OSError:
            os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"


def _reach(host: str, port: int) -> None:
    socket.create_connection((host, port), _REACHED_WITHIN).close()


def _connect(ray: Any, address: str) -> None:
    """Connect this process to a cluster.

    Raises:
        SweepError: There is no cluster at this address.
    """
    try:
        with _signals_kept():
            ray.init(address=address, configure_logging=False, log_to_driver=False)
    except (OSError, RuntimeError, ValueError) as error:
        raise SweepError(_unreachable(address, error)) from error


def _unreachable(address: str, error: Exception) -> str:
    reason = str(error).strip().partition("\n")[0]
    return f"there is no Ray cluster at {address}: {reason}; `ray start --head` starts one and says its address"


@contextmanager
def _signals_kept() -> Iterator[None]:
    """Preserve the handler of SIGTERM, which Ray would replace."""
    handler = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        if handler is not None and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, handler)
