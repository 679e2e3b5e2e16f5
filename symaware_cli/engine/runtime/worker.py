"""A worker process: runs `_compute` of components with `run_in: process`.

It holds a replica of each entry and receives the changes before each computation. All data in its two pipes was
pickled by the run that started it, or by the worker.
"""

from __future__ import annotations

import pickle
from typing import BinaryIO

import numpy as np

from symaware_cli.engine.runtime.replica import ComputationResult, Replica
from symaware_cli.world import read, write


@np.errstate(all="ignore")  # as in the process of the run
def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer requests until the pipe is closed; a request is a pickled tuple of an entry's number and its arguments.

    The first message is a list with the pickled `EntryDescription` of each entry.
    """
    replicas = [_replica(each) for each in pickle.loads(read(requests))]
    write(answers, pickle.dumps(None))  # ready: the time for imports does not count as part of a turn
    while True:
        try:
            number, *arguments, rows = pickle.loads(read(requests))
        except EOFError:
            return
        replica = replicas[number]
        try:
            if isinstance(replica, BaseException):
                raise replica
            outcomes = replica.compute(*arguments, rows)
        except BaseException as error:
            outcomes = [ComputationResult.of_failure(row, error) for row, *_ in rows]
        write(answers, pickle.dumps(outcomes))


def _replica(description: bytes) -> Replica | BaseException:
    """Make a replica; if that fails, return the exception, with which each request is then answered."""
    try:
        return Replica(pickle.loads(description))
    except BaseException as error:
        return error
