"""Python processes that this process starts to compute something for it, and that end with it."""

from __future__ import annotations

import ctypes
import json
import os
import signal
import struct
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from typing import BinaryIO

from symaware_cli import processor

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
    return _exactly(pipe, _LENGTH.unpack(_exactly(pipe, _LENGTH.size))[0])


def _exactly(pipe: BinaryIO, count: int) -> bytes:
    data = bytearray()
    while len(data) < count:
        part = pipe.read(count - len(data))
        if not part:
            raise EOFError
        data += part
    return bytes(data)


class PythonChild:
    """A process that runs one function of this package, in the same environment and with the same results.

    The function gets two pipes, for requests and for answers. Its output goes to the standard error stream. It ignores
    Ctrl-C, which reaches all processes of a terminal, and is killed when this process ends for any reason.

    Attributes:
        requests: The end of the pipe into which requests are written.
        answers: The end of the pipe from which answers are read.
    """

    def __init__(
        self,
        target: str,
        *,
        variables: Mapping[str, str] | None = None,
        shares_path: bool = True,
        own_session: bool = False,
        descriptors: Sequence[int] = (),
    ) -> None:
        """Start the process, without waiting for it.

        Args:
            target: The function, as ``module:function``.
            variables: Its environment; by default that of this process, with the same instruction set.
            shares_path: Whether it has the module search path of this process.
            own_session: Whether signals of the terminal do not reach it.
            descriptors: File descriptors that it has as well, under the same numbers.
        """
        theirs_in, ours_out = os.pipe()
        ours_in, theirs_out = os.pipe()
        code = f"from {__name__} import enter; enter({target!r}, {theirs_in}, {theirs_out}, {os.getpid()})"
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", code],
            pass_fds=(theirs_in, theirs_out, *descriptors),
            stdin=subprocess.DEVNULL,
            start_new_session=own_session,
            env=processor.environment() if variables is None else variables,
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self.requests, self.answers = os.fdopen(ours_out, "wb"), os.fdopen(ours_in, "rb")
        with suppress(BrokenPipeError):  # whoever reads the answers finds out how it ended
            write(self.requests, json.dumps(sys.path if shares_path else None).encode())

    def kill(self) -> None:
        """Kill the process unconditionally."""
        self._process.kill()

    def close(self) -> int:
        """Close the pipes, wait for the end of the process, and return its exit status."""
        for pipe in (self.requests, self.answers):
            with suppress(BrokenPipeError):  # data was left in the buffer
                pipe.close()
        return self._process.wait()


def how_it_ended(status: int) -> str:
    """Describe how a process ended, as a predicate."""
    if status >= 0:
        return f"ended with exit status {status}"
    try:
        return f"was killed by {signal.Signals(-status).name}"
    except ValueError:
        return f"was killed by signal {-status}"


def enter(target: str, incoming: int, outgoing: int, parent: int) -> None:
    """Run a function in the process that was started for it.

    Args:
        target: The function, as ``module:function``.
        incoming: The file descriptor of the requests.
        outgoing: That of the answers.
        parent: The process that started this one.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        return
    os.dup2(2, 1)
    with os.fdopen(incoming, "rb") as requests, os.fdopen(outgoing, "wb") as answers, suppress(BrokenPipeError):
        try:
            path = json.loads(read(requests))
        except EOFError:
            return
        if path is not None:
            sys.path[:] = path
        module, _, function = target.partition(":")
        getattr(import_module(module), function)(requests, answers)
