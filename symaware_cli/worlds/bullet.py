"""The PyBullet engine: a client for each world, with the engine's terminal output captured."""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from symaware_cli.core import WorldError


@contextmanager
def quiet() -> Iterator[list[str]]:
    """Capture the output of the engine from C; on exit the list holds the lines."""
    output: list[str] = []
    libc = ctypes.CDLL(None) if os.name == "posix" else None
    # Python has no stream where the process was started without one.
    streams = [stream for stream in (sys.stdout, sys.stderr) if stream is not None]
    if libc is None or len(streams) < 2:
        yield output
        return
    for stream in streams:
        stream.flush()
    kept = [os.dup(number) for number in (1, 2)]
    with tempfile.TemporaryFile() as file:
        libc.fflush(None)
        for number in (1, 2):
            os.dup2(file.fileno(), number)
        try:
            yield output
        finally:
            libc.fflush(None)
            for number, own in zip((1, 2), kept, strict=True):
                os.dup2(own, number)
                os.close(own)
            file.seek(0)
            output += file.read().decode(errors="replace").splitlines()


with quiet():
    import pybullet as engine

__all__ = ["MOST_SHOWN", "Client", "engine", "quiet"]

#: Without gravity: bodies bounce without loss at any speed; PyBullet's default of 0.2 m/s is meant for larger ones.
_FLOATING = {"restitutionVelocityThreshold": 1e-3, "contactSlop": 0.0}

#: With gravity: a contact lasts within the slop [m], or stacks would never come to rest. A bounce may lose as much
#: speed as one slop per physics step.
_RESTING = {"restitutionVelocityThreshold": 0.01, "contactSlop": 1e-5}

#: The most bodies that the window of PyBullet can show.
MOST_SHOWN = 1024


class Client:
    """A connection to an engine that belongs to one world.

    It is closed by `close`, or when it is garbage-collected.

    Attributes:
        id: The id to pass to the engine's functions as ``physicsClientId``.
    """

    def __init__(self, window: bool) -> None:
        """Connect.

        Args:
            window: Whether to show a window.

        Raises:
            WorldError: There is no screen, or too many worlds are open at once.
        """
        if window and sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
            # Without a screen the engine would terminate the process.
            raise WorldError("there is no screen to show a window on", "environment", "with", "gui")
        with quiet():
            self.id: int = engine.connect(engine.GUI if window else engine.DIRECT)
        if self.id < 0:
            raise WorldError("PyBullet opens no more worlds in this process; close some")
        self._end = weakref.finalize(self, _disconnect, self.id)

    def set(self, step_time: float, gravity: Sequence[float], iterations: int, recovery: float) -> None:
        """Set how the engine computes.

        Args:
            step_time: Duration of a physics step [s].
            gravity: Acceleration [x, y, z] [m/s^2].
            iterations: Solver iterations in a physics step.
            recovery: Part of an overlap that a physics step undoes.
        """
        engine.setTimeStep(step_time, self.id)
        engine.setGravity(*gravity, self.id)
        engine.setPhysicsEngineParameter(
            numSolverIterations=iterations,
            contactERP=recovery,
            **(_RESTING if any(gravity) else _FLOATING),
            # Split impulses separate overlapping bodies, however small the overlap, without changing velocities.
            useSplitImpulse=1,
            splitImpulsePenetrationThreshold=0.0,
            physicsClientId=self.id,
        )

    def close(self) -> None:
        """Disconnect; further calls have no effect."""
        self._end()


def _disconnect(client: int) -> None:
    if engine.isConnected(client):
        engine.disconnect(client)
