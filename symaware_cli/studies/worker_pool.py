"""Worker processes, which are started once and take blocks; one that dies or hangs costs the run it was at."""

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

#: Wall time beyond its time-out after which a run that does not heed it is ended with its worker [s].
_GRACE = 2.0

#: How many workers may die one after the other before they are ready.
_PATIENCE = 3


class WorkerPoolError(Exception):
    """No worker process can be started."""


class CodeDifferenceError(SweepError):
    """A worker process on another machine has other code than the process that sent for it."""


class WorkerPool(Generic[ResultT]):
    """An `Executor` of worker processes."""

    def __init__(
        self,
        work: Work[ResultT],
        count: int,
        timeout: float | None = None,
        code: CodeIdentity | None = None,
    ) -> None:
        """Prepare; workers are started when there is something to do.

        Args:
            work: What they make.
            count: How many workers, at most.
            timeout: Wall time after which a run is given up [s]; None for never.
            code: The code that workers have to have, where rows are made for another machine; None to let them have
                that of this process.
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
            CodeDifferenceError: One has other code.
            SweepError: One cannot make a result; the message is its reason.
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
        """End all workers, whatever they do."""
        for worker in self._workers:
            worker.kill()
            self._selector.unregister(worker.answers)
            worker.end()
        self._workers.clear()

    def _employ(self, blocks: Blocks) -> None:
        """Give every idle worker something to do, and start workers where there is more."""
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
            # If it was interrupted in between, nobody would end the worker.
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
        """Go on without a worker: what it was at is lost, the rest of its block is for others."""
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
    """Have some work done in this process, or in worker processes.

    Args:
        work: The work.
        jobs: How many worker processes; 0 for this process.
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
        tasks: The runs that it still has to make, the one it is at first.
        is_ready: Whether it has started.
        deadline: When the run it is at is given up, on the monotonic clock [s]; None for never.
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
            # Ctrl-C is for the driver alone, which ends its workers.
            own_session=True,
        )
        self.answers = self._child.answers
        self._send({"work": work, "code": None if code is None else code.to_json()})

    def give(self, block: Block) -> None:
        """Tell it what to do next."""
        self.tasks.extend(block.indices)
        self._send(asdict(block))
        self._start_clock()

    def read(self) -> tuple[list[dict[str, Any]], bool]:
        """Return the results that it has told, and whether there may be more.

        Raises:
            CodeDifferenceError: It has other code.
            SweepError: It cannot make a result; the message is its reason.
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
        """End it, whatever it does."""
        self._child.kill()

    def end(self) -> str:
        """Wait for its end, and say how it came."""
        return f"the worker process {how_it_ended(self._child.close())}"

    def _start_clock(self) -> None:
        if self._timeout is not None:
            running = self.tasks and self.is_ready
            self.deadline = time.monotonic() + self._timeout + _GRACE if running else None

    def _send(self, content: object) -> None:
        # If it is gone, that is seen where its answers are read.
        with suppress(BrokenPipeError):
            self._child.requests.write(json.dumps(content).encode() + b"\n")
            self._child.requests.flush()


def _chosen(variables: Mapping[str, str]) -> dict[str, str]:
    """The environment of this process, with other variables that choose among kernels."""
    return {name: each for name, each in os.environ.items() if name not in processor.VARIABLES} | {**variables}
