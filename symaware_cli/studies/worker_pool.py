"""A pool of worker processes that execute blocks; a worker that dies or hangs costs only its current run."""

from __future__ import annotations

import json
import os
import selectors
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from typing import Any, Generic

from symaware_cli import processor
from symaware_cli.log import OutputError
from symaware_cli.studies.executor import (
    Block,
    Blocks,
    Executor,
    LocalExecutor,
    ResultT,
    Work,
    description,
    signals_deferred,
)
from symaware_cli.studies.identity import CodeIdentity
from symaware_cli.studies.sweep_error import SweepError, listed
from symaware_cli.world import PythonChild, how_it_ended

#: Wall time beyond its time-out after which a run that ignores the time-out is ended with its worker [s].
_GRACE = 2.0

#: The maximum number of consecutive workers that die before they are ready.
_PATIENCE = 3


class WorkerPoolError(Exception):
    """No worker process can be started."""


class CodeDifferenceError(SweepError):
    """A worker process on another machine has different code from the requesting process."""


class WorkerPool(Generic[ResultT]):
    """An `Executor` of worker processes."""

    def __init__(
        self,
        work: Work[ResultT],
        count: int,
        timeout: float | None = None,
        code: CodeIdentity | None = None,
    ) -> None:
        """Prepare; workers are started when there are blocks.

        Args:
            work: The work.
            count: The maximum number of workers.
            timeout: Wall time after which a run is abandoned [s]; None for never.
            code: The code that workers must have if they compute rows for another machine; None if they share the
                environment and code of this process.
        """
        self._work = work
        self._code = code
        self._count = count
        self._timeout = timeout
        self._workers: list[_Worker] = []
        self._selector = selectors.DefaultSelector()
        self._stillborn = 0

    def results(self, blocks: Blocks) -> Iterator[ResultT]:
        """See `Executor`.

        Raises:
            WorkerPoolError: No worker can be started.
            CodeDifferenceError: A worker has different code.
            SweepError: A worker cannot compute a result; the message gives the reason.
        """
        while True:
            self._employ(blocks)
            if not any(worker.tasks for worker in self._workers):
                return
            for worker in self._awaited():
                received, alive = worker.read()
                for content in received:
                    result = self._work.received(content)
                    blocks.learn(result.wall_time)
                    yield result
                if not alive:
                    yield from self._buried(worker, blocks, worker.end())
            now = time.monotonic()
            for worker in [each for each in self._workers if each.deadline is not None and each.deadline < now]:
                worker.kill()
                yield from self._buried(worker, blocks, f"it did not end within {self._timeout:g} s")

    def close(self) -> None:
        """End all workers immediately."""
        for worker in self._workers:
            worker.kill()
            self._selector.unregister(worker.answers)
            worker.end()
        self._workers.clear()

    def _employ(self, blocks: Blocks) -> None:
        """Give every idle worker a block, and start workers for further blocks."""
        for worker in self._workers:
            if not worker.tasks:
                block = blocks.take(self._count)
                if block is None:
                    return
                worker.give(block)
        while len(self._workers) < self._count:
            block = blocks.take(self._count)
            if block is None:
                return
            # An interrupt in between would leave a worker that is never ended.
            with signals_deferred():
                worker = _Worker(description(self._work), self._timeout, self._code)
                self._workers.append(worker)
                self._selector.register(worker.answers, selectors.EVENT_READ, worker)
            worker.give(block)

    def _awaited(self) -> list[_Worker]:
        """Wait for answers, or for the first deadline."""
        deadlines = [each.deadline for each in self._workers if each.deadline is not None]
        patience = max(0.0, min(deadlines) - time.monotonic()) + 0.01 if deadlines else None
        return [key.data for key, _ in self._selector.select(patience)]

    def _buried(self, worker: _Worker, blocks: Blocks, why: str) -> Iterator[ResultT]:
        """Remove a dead worker: its current run is lost, and the rest of its block is returned for other workers."""
        self._workers.remove(worker)
        self._selector.unregister(worker.answers)
        worker.end()
        tasks = list(worker.tasks)
        if worker.is_ready:
            self._stillborn = 0
            if tasks:
                yield self._work.lost(tasks.pop(0), why)
        else:
            self._stillborn += 1
            if self._stillborn >= _PATIENCE:
                raise WorkerPoolError(f"no worker process can be started: {why}")
        blocks.give_back(tasks)


@contextmanager
def executor_of(work: Work[ResultT], jobs: int, timeout: float | None = None) -> Iterator[Executor[ResultT]]:
    """Provide an executor of work in this process or in worker processes.

    Args:
        work: The work.
        jobs: The number of worker processes; 0 for this process.
        timeout: See `WorkerPool`.
    """
    executor: Executor[ResultT] = LocalExecutor(work) if jobs == 0 else WorkerPool(work, jobs, timeout)
    try:
        yield executor
    finally:
        executor.close()


class _Worker:
    """One worker process.

    Attributes:
        tasks: Its remaining runs, the current one first.
        is_ready: Whether it has started.
        deadline: When its current run is abandoned, on the monotonic clock [s]; None for never.
    """

    def __init__(self, work: Mapping[str, Any], timeout: float | None, code: CodeIdentity | None) -> None:
        self.tasks: deque[int] = deque()
        self.is_ready = False
        self.deadline: float | None = None
        self._timeout = timeout
        self._rest = b""
        self._child = PythonChild(
            "symaware_cli.studies.pool_worker:serve",
            variables=None if code is None else _chosen(code.variables),
            shares_path=code is None,
            # Ctrl-C must reach only the driver, which ends its workers.
            own_session=True,
        )
        self.answers = self._child.answers
        self._send({"work": work, "code": None if code is None else code.to_json()})

    def give(self, block: Block) -> None:
        """Send the next block to the worker."""
        self.tasks.extend(block.indices)
        self._send(asdict(block))
        self._start_clock()

    def read(self) -> tuple[list[dict[str, Any]], bool]:
        """Return the results received so far, and whether there may be more.

        Raises:
            CodeDifferenceError: The worker has different code.
            SweepError: The worker cannot compute a result; the message gives the reason.
        """
        data = os.read(self.answers.fileno(), 1 << 20)
        *lines, self._rest = (self._rest + data).split(b"\n")
        received = []
        for line in lines:
            content = json.loads(line)
            if isinstance(content, list):
                if content:
                    raise CodeDifferenceError(
                        listed("other code than where the sweep was started: rows would not be comparable", content)
                    )
                self.is_ready = True
            elif "error" in content:
                raise (OutputError if content.get("is_output") else SweepError)(content["error"])
            else:
                index, result = content["index"], content["result"]
                received.append(result)
                self.tasks.remove(index)
        if lines:
            self._start_clock()
        return received, bool(data)

    def kill(self) -> None:
        """Kill the worker."""
        self._child.kill()

    def end(self) -> str:
        """Wait for the end of the process, and describe how it ended."""
        return f"the worker process {how_it_ended(self._child.close())}"

    def _start_clock(self) -> None:
        if self._timeout is not None:
            running = self.tasks and self.is_ready
            self.deadline = time.monotonic() + self._timeout + _GRACE if running else None

    def _send(self, content: object) -> None:
        # A dead worker is detected where its answers are read.
        with suppress(BrokenPipeError):
            self._child.requests.write(json.dumps(content).encode() + b"\n")
            self._child.requests.flush()


def _chosen(variables: Mapping[str, str]) -> dict[str, str]:
    """Return this process's environment with the given values of the variables that select kernels."""
    return {name: each for name, each in os.environ.items() if name not in processor.VARIABLES} | {**variables}
