"""A worker process: runs `_compute` of components with `run_in: process`.

It holds a replica of each entry and receives the changes before each computation. All data in its two pipes was
pickled by the run that started it, or by the worker.
"""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
import struct
import sys
from contextlib import suppress
from typing import BinaryIO

import numpy as np

from symaware_cli.runtime.replica import ComputationResult, Replica

#: The option of `prctl` that sets the signal sent to a process when its parent ends (Linux).
_PR_SET_PDEATHSIG = 1

_LENGTH = struct.Struct("<Q")


def write(pipe: BinaryIO, data: bytes) -> None:
    """Send a message."""
    pipe.write(_LENGTH.pack(len(data)))
    pipe.write(data)
    pipe.flush()


def read(pipe: BinaryIO) -> bytes:
    """Receive a message.

    Raises:
        EOFError: The other side has closed the pipe.
    """
    length = _LENGTH.unpack(_exactly(pipe, _LENGTH.size))[0]
    return _exactly(pipe, length)


def _exactly(pipe: BinaryIO, count: int) -> bytes:
    data = bytearray()
    while len(data) < count:
        part = pipe.read(count - len(data))
        if not part:
            raise EOFError
        data += part
    return bytes(data)


@np.errstate(all="ignore")  # as in the process of the run
def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer requests until the pipe is closed; a request is a pickled tuple of an entry's number and its arguments.

    The first message is `sys.path`, the second a list with the pickled `EntryDescription` of each entry.
    """
    sys.path[:] = pickle.loads(read(requests))
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


def end_with(parent: int) -> bool:
    """Let this process end with the one that started it; returns whether that is still there."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    return os.getppid() == parent


def main(incoming: int, outgoing: int, parent: int) -> None:
    """Serve the process that started this one."""
    # Ctrl-C reaches all processes of a terminal; the process of the run handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if not end_with(parent):
        return
    with os.fdopen(incoming, "rb") as requests, os.fdopen(outgoing, "wb") as answers, suppress(BrokenPipeError):
        serve(requests, answers)
