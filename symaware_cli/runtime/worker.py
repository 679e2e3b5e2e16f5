"""A worker process: computes for components that are to run in a process of their own.

It holds a replica of each entry, and is told before each computation what has changed. All that goes through its two
pipes was pickled by the run that started it, or by itself.
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

#: What tells the kernel to end a process with the one that started it (Linux).
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
        EOFError: The other side is gone.
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


@np.errstate(all="ignore")  # as in the process that it works for
def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer requests until there are no more: pickled tuples of a entry's number and the arguments of `compute`.

    The first message is what `sys.path` shall be, the second for each entry its `EntryDescription`, pickled.
    """
    sys.path[:] = pickle.loads(read(requests))
    replicas = [_replica(each) for each in pickle.loads(read(requests))]
    write(answers, pickle.dumps(None))  # ready: what has to be imported does not count as a turn
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
    """Make a replica; what is raised meanwhile is told to whoever asks for a computation."""
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
    """Be a worker of the process that started this one."""
    # Ctrl-C reaches all processes of a terminal; the run decides what becomes of it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if not end_with(parent):
        return
    with (
        os.fdopen(incoming, "rb") as requests,
        os.fdopen(outgoing, "wb") as answers,
        suppress(BrokenPipeError),
    ):
        serve(requests, answers)
