"""A worker process that makes the episodes of some rows of a vector environment.

The process reads requests, ``begin`` or ``step``, from its pipe, and answers when each is done; all other data is in
shared memory. Its first request and its answers were pickled by the process that started it, or by itself.
"""

from __future__ import annotations

import pickle
import traceback
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from symaware_cli.api import RunFailedError
from symaware_cli.learning.row_arrays import RowSizes
from symaware_cli.learning.row_definition import RowDefinition
from symaware_cli.learning.shared_rows import SharedRows
from symaware_cli.learning.team import LearningError
from symaware_cli.world import read, write


class WorkerSetup(NamedTuple):
    """The first request to a worker process, from which it creates its rows.

    Attributes:
        source: The definition of the rows, a pickled `RowDefinition`.
        sizes: The sizes of the arrays of all rows.
        workers: The number of worker processes.
        number: The number of this process.
        rows: The rows of this process.
        descriptor: The file descriptor of the shared memory.
    """

    source: bytes
    sizes: RowSizes
    workers: int
    number: int
    rows: slice
    descriptor: int


class WorkerAnswer(NamedTuple):
    """The answer of a worker process to a request.

    Attributes:
        digest: The digest of the scenario, once the process is ready.
        unbatched: The reason why its rows are not batched, once the process is ready; None if they are.
        error: The message of the error that ended the request; empty without an error.
        trace: Its traceback.
        failure: The arguments of the `RunFailedError` if a run failed.
    """

    digest: bytes = b""
    unbatched: str | None = None
    error: str = ""
    trace: str = ""
    failure: tuple[Any, ...] | None = None


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer requests until the pipe is closed."""
    try:
        setup: WorkerSetup = pickle.loads(read(requests))
    except EOFError:
        return
    try:
        rows = _WorkerRows(setup)
    except Exception as error:
        write(answers, pickle.dumps(_failed(error)))
        return
    write(answers, pickle.dumps(WorkerAnswer(rows.digest, rows.unbatched)))
    while True:
        try:
            request = read(requests)
        except EOFError:
            return
        answer = WorkerAnswer()
        try:
            rows.make(begins=request == b"begin")
        except Exception as error:
            answer = _failed(error)
        write(answers, pickle.dumps(answer))


class _WorkerRows:
    """The rows of this process.

    Attributes:
        digest: The digest of the scenario.
        unbatched: See `WorkerAnswer`.
    """

    def __init__(self, setup: WorkerSetup) -> None:
        made: RowDefinition = pickle.loads(setup.source)
        episodes = made.episodes()
        self.digest = episodes.built.digest
        self._own = setup.rows
        self._source, self.unbatched = made.rows(self._own.stop - self._own.start, episodes)
        self._shared = SharedRows(setup.sizes, setup.workers, setup.descriptor)
        self._number = setup.number
        self._source.arrays = self._shared.part(self._own)

    def make(self, *, begins: bool) -> None:
        """Begin an episode or make a step in the chosen rows."""
        shared, own = self._shared, self._own
        rows = np.flatnonzero(shared.chosen[own])
        # Rows that are not batched are computed one by one, so that progress can be observed.
        for part in [rows] if self.unbatched is None else rows[:, None]:
            if begins:
                self._source.begin(part, shared.seeds[own][part].tolist())
            else:
                self._source.step(part, shared.actions[own], shared.given[own])
            shared.made[self._number] += len(part)


def _failed(error: Exception) -> WorkerAnswer:
    failure = None
    if isinstance(error, RunFailedError):
        failure = str(error), error.run.summary, error.source, error.plugin, error.time, error.problem
    only = "".join(traceback.format_exception_only(error)).strip()
    said = str(error) if isinstance(error, LearningError) else only
    return WorkerAnswer(error=said, trace=traceback.format_exc(), failure=failure)
