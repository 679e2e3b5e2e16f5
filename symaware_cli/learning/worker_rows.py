"""Rows of a vector environment in worker processes: results do not depend on their number.

Each process computes the episodes of a block of rows, as a batch or one by one, like the process of the environment
would.

Reasons: docs/decisions/0102-rows-in-processes.md
"""

from __future__ import annotations

import pickle
import select
import time
import weakref
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from typing import NoReturn

from symaware_cli.api import RunFailedError, RunResult
from symaware_cli.learning.row_arrays import Array, RowArrays, Rows, RowSizes, Truths
from symaware_cli.learning.row_definition import RowDefinition
from symaware_cli.learning.row_worker import WorkerAnswer, WorkerSetup
from symaware_cli.learning.shared_rows import SharedRows, shared_memory
from symaware_cli.learning.team import LearningError
from symaware_cli.world import PythonChild, how_it_ended, read, write

#: Wall time between two checks of the progress of a worker process, as a part of its time limit.
_LOOKS = 10


class WorkerRows:
    """Computes the episodes of all rows in worker processes.

    If a process ends, or makes no progress, all are ended, and the environment cannot be used any more. An error in a
    row is raised here; of several, that of the first process. After that, rows have to begin again with `begin`.

    Attributes:
        arrays: See `EpisodeSource`.
        unbatched: The reason why rows are not batched; None if each process computes its rows as a batch.
    """

    def __init__(
        self, sizes: RowSizes, source: RowDefinition, workers: int, timeout: float | None, digest: bytes
    ) -> None:
        """Start the processes, and wait until they are ready.

        Args:
            sizes: The sizes of the arrays.
            source: The definition of the rows.
            workers: The number of processes, at least 1; at most one for each row is started.
            timeout: Wall time after which a process without progress is considered hung [s]; None for no limit.
            digest: The digest of the scenario.

        Raises:
            LearningError: The scenario or a function cannot be sent to another process, or a process cannot be started.
        """
        content = _pickled(source)
        count = min(workers, sizes.rows)
        self._timeout = timeout
        self._ended = ""
        self._workers: list[_Worker] = []
        self._finalizer = weakref.finalize(self, _end, self._workers)
        bounds = [sizes.rows * number // count for number in range(count + 1)]
        with shared_memory(sizes, count) as descriptor:
            self._shared = SharedRows(sizes, count, descriptor)
            self.arrays: RowArrays = self._shared
            for number, (first, end) in enumerate(pairwise(bounds)):
                setup = WorkerSetup(content, sizes, count, number, slice(first, end), descriptor)
                self._workers.append(_Worker(setup))
            # No time limit: the scenario was built here before, and processes take some time to import everything.
            answers = [self._answer(each, None) for each in self._workers]
        self._raise_first(answers, fatal=True)
        if any(each.digest != digest for each in answers):
            self._fail("the files of the scenario were changed while the worker processes started")
        self.unbatched = answers[0].unbatched

    def begin(self, rows: Rows, seeds: Sequence[int]) -> None:
        """See `EpisodeSource`."""
        self._shared.seeds[rows] = seeds
        self._ask(rows, b"begin")

    def step(self, rows: Rows, actions: Array, given: Truths) -> None:
        """See `EpisodeSource`."""
        self._shared.actions[...] = actions
        self._shared.given[...] = given
        self._ask(rows, b"step")

    def _ask(self, rows: Rows, request: bytes) -> None:
        """Send a request to the processes of some rows, and wait for all of them."""
        if self._ended:
            raise LearningError(self._ended)
        chosen = self._shared.chosen
        chosen[:] = False
        chosen[rows] = True
        asked = [each for each in self._workers if chosen[each.rows].any()]
        try:
            for each in asked:
                each.ask(request)
            answers = [self._answer(each, self._timeout) for each in asked]
        except BaseException as error:
            if not self._ended:  # by Ctrl-C: outstanding answers would be taken for those of later requests
                self._end(f"the worker processes of the environment were ended by {type(error).__name__}")
            raise
        self._raise_first(answers, fatal=False)

    def _answer(self, worker: _Worker, timeout: float | None) -> WorkerAnswer:
        """Wait for the answer of a process, while it makes progress."""
        made, since = -1, time.monotonic()
        while not select.select([worker.child.answers], [], [], None if timeout is None else timeout / _LOOKS)[0]:
            now = int(self._shared.made[worker.number])
            if now != made:
                made, since = now, time.monotonic()
            elif timeout is not None and time.monotonic() - since > timeout:
                self._fail(f"{worker.name} made no progress for {timeout:g} s, and was killed")
        try:
            found = pickle.loads(read(worker.child.answers))
        except EOFError:
            self._fail(f"{worker.name} {how_it_ended(worker.child.close())}")
        assert isinstance(found, WorkerAnswer)
        return found

    def _raise_first(self, answers: Sequence[WorkerAnswer], *, fatal: bool) -> None:
        """Raise the error of the first process with an error."""
        failed = next((each for each in answers if each.error), None)
        if failed is None:
            return
        if fatal:
            self._end(failed.error)
        error: Exception = LearningError(failed.error)
        if failed.failure is not None:
            message, summary, *rest = failed.failure
            error = RunFailedError(message, RunResult(summary), *rest)
        error.add_note(f"In the worker process:\n{failed.trace}")
        raise error

    def _fail(self, reason: str) -> NoReturn:
        self._end(reason)
        raise LearningError(reason)

    def _end(self, reason: str) -> None:
        self._ended = reason
        self._finalizer()

    def close(self) -> None:
        """End all processes."""
        self._end("the environment was closed")


class _Worker:
    """A worker process.

    Attributes:
        number: The number of the process.
        rows: The rows of the process.
        name: The name of the process in messages.
        child: The process.
    """

    def __init__(self, setup: WorkerSetup) -> None:
        self.number = setup.number
        self.rows = setup.rows
        first, last = self.rows.start, self.rows.stop - 1
        which = f"row {first}" if first == last else f"rows {first} to {last}"
        self.name = f"the worker process of {which}"
        self.child = PythonChild(
            "symaware_cli.learning.row_worker:serve", own_session=True, descriptors=(setup.descriptor,)
        )
        self.ask(pickle.dumps(setup))

    def ask(self, request: bytes) -> None:
        """Send a request."""
        with suppress(BrokenPipeError):  # if the process has ended, reading its answer reports that
            write(self.child.requests, request)


def _end(workers: Sequence[_Worker]) -> None:
    """Kill processes, even busy ones, and wait for their end."""
    for each in workers:
        each.child.kill()
    for each in workers:
        each.child.close()


def _pickled(source: RowDefinition) -> bytes:
    """Pickle the definition of rows.

    Raises:
        LearningError: A function cannot be imported in another process, or the scenario cannot be pickled.
    """
    for name, function in source.functions._asdict().items():
        if function is not None and (
            getattr(function, "__module__", None) == "__main__" or "<" in getattr(function, "__qualname__", "")
        ):
            raise LearningError(
                f"worker processes cannot import the function `{name}`: define it at the top of a module, not in the "
                "main program or in another function"
            )
    try:
        return pickle.dumps(source)
    except Exception as error:
        raise LearningError(f"the scenario cannot be sent to worker processes: {error}") from error
