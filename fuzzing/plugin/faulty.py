"""Components that misbehave in a chosen way, at a chosen turn."""

import asyncio
import ctypes
import gc
import itertools
import os
import signal
import sys
import threading
import time
from typing import Any

import numpy as np
from pydantic import Field

from symaware_cli import Component, Controller, GroupComponent, Message, Parameters, TimeSeries


class UnprintableError(Exception):
    """Cannot be told."""

    def __str__(self) -> str:
        raise RuntimeError("no words")

    __repr__ = __str__


class Unkind(BaseException):
    """Not an Exception."""


def _deep(level: int = 0) -> int:
    return _deep(level + 1) + 1


def _raising(error: BaseException | type[BaseException]) -> Any:
    def misbehave(component: Any) -> None:
        raise error

    return misbehave


def _thread(daemon: bool, work: Any) -> Any:
    def misbehave(component: Any) -> None:
        threading.Thread(target=work, daemon=daemon, name="left behind").start()

    return misbehave


def _forever() -> None:
    while True:
        time.sleep(0.1)


def _busy() -> None:
    while True:
        pass


def _itself() -> list[Any]:
    value: list[Any] = [1]
    value.append(value)
    return value


def _agent(component: Any) -> Any:
    return component._agent if hasattr(component, "_agent") else component.group.agents[0]


def _know(value: Any) -> Any:
    def misbehave(component: Any) -> None:
        _agent(component).self_knowledge["thing"] = value() if callable(value) else value

    return misbehave


def _close_everything(component: Any) -> None:
    os.closerange(3, 64)


def _write(array: Any) -> None:
    array[...] = 7.0


def _interrupted(*names: str) -> Any:
    def misbehave(component: Any) -> None:
        for name in names:
            os.kill(os.getpid(), getattr(signal, name))
        time.sleep(0.05)

    return misbehave


#: Exceptions that a component can raise.
ERRORS: list[BaseException | type[BaseException]] = [
    *(ValueError("no"), ValueError(), ValueError("\ud800 \x00 \x1b[31m"), ValueError("x" * 1_000_000)),
    *(KeyError("a"), OSError(28, "No space left on device"), UnprintableError(), Unkind("no"), MemoryError()),
    *(KeyboardInterrupt(), SystemExit(0), SystemExit("text"), GeneratorExit(), StopIteration(3)),
    *(StopAsyncIteration(), asyncio.CancelledError(), BrokenPipeError(), AssertionError, RecursionError()),
    *(ExceptionGroup("many", [ValueError("a"), KeyError("b")]), BaseExceptionGroup("all", [Unkind()])),
    *(EOFError(), ImportError("gone"), SyntaxError("bad"), UnicodeDecodeError("utf-8", b"x", 0, 1, "y")),
]

#: The misbehaviours of components, by name.
ACTS: dict[str, Any] = {
    **{
        f"raise-{type(error).__name__ if isinstance(error, BaseException) else error.__name__}-{number}": _raising(
            error
        )
        for number, error in enumerate(ERRORS)
    },
    "recurse": lambda component: _deep(),
    "sleep": lambda component: time.sleep(600),
    "busy": lambda component: _busy(),
    "native": lambda component: ctypes.CDLL(None).sleep(600),
    "daemon-thread": _thread(True, _forever),
    "thread": _thread(False, _forever),
    "raising-thread": _thread(True, lambda: 1 / 0),
    "exit-0": lambda component: os._exit(0),
    "exit-7": lambda component: os._exit(7),
    "sys-exit": lambda component: sys.exit(5),
    "abort": lambda component: os.abort(),
    "kill": _interrupted("SIGKILL"),
    "terminate": _interrupted("SIGTERM"),
    "interrupt": _interrupted("SIGINT"),
    "interrupt-twice": _interrupted("SIGINT", "SIGINT"),
    "hang-up": _interrupted("SIGHUP"),
    "default-signals": lambda component: [signal.signal(each, signal.SIG_DFL) for each in (2, 15)],
    "close-files": _close_everything,
    "close-output": lambda component: [sys.stdout.close(), sys.stderr.close()],
    "no-output": lambda component: vars(sys).update(stdout=None, stderr=None),
    "print": lambda component: print("{not json", flush=True),
    "print-native": lambda component: os.write(1, b"{not json\n"),
    "elsewhere": lambda component: os.chdir("/"),
    "no-environment": lambda component: os.environ.clear(),
    "shallow": lambda component: sys.setrecursionlimit(80),
    "strict-numbers": lambda component: np.seterr(all="raise"),
    "no-collector": lambda component: gc.disable(),
    "no-modules": lambda component: sys.modules.clear(),
    "write-state": lambda component: _write(component.environment.state(_agent(component).group)),
    "write-belief": lambda component: _write(_agent(component).group.awareness.state),
    "write-snapshot": lambda component: _write(component.environment.snapshot().positions),
    "write-knowledge": lambda component: _agent(component).self_knowledge["goal"].__setitem__(0, 99.0),
    "no-knowledge": lambda component: _agent(component).self_knowledge.clear(),
    "know-itself": _know(_itself),
    "know-nan": _know([float("nan")]),
    "know-object": _know(object),
    "know-lambda": _know(lambda: _know),
    "know-much": _know(lambda: np.zeros(2_000_000)),
    "know-surrogate": _know("\ud800"),
    "know-deep": _know(lambda: [__import__("functools").reduce(lambda inner, _: [inner], range(5000), 1)]),
    "input-nan": lambda component: setattr(_agent(component).model, "control_input", [float("nan"), 0]),
    "input-short": lambda component: setattr(_agent(component).model, "control_input", [1.0]),
    "input-complex": lambda component: setattr(_agent(component).model, "control_input", np.array([1j, 0])),
    "input-text": lambda component: setattr(_agent(component).model, "control_input", "fast"),
    "input-huge": lambda component: setattr(_agent(component).model, "control_input", [1e308, 1e308]),
    "intent-bad": lambda component: setattr(_agent(component).self_awareness, "intent", TimeSeries({1.0: [np.inf]})),
    "intent-none": lambda component: setattr(_agent(component).self_awareness, "intent", None),
    "state-nan": lambda component: setattr(_agent(component).self_awareness, "state", [np.nan] * 2),
    "emit-itself": lambda component: component.emit("odd", data=_itself()),
    "emit-nan": lambda component: component.emit("odd", value=float("nan"), other=object()),
    "emit-name": lambda component: component.emit("\ud800\x00", "\x1b[2J"),
    "emit-many": lambda component: [component.emit("many", "x" * 1000) for _ in range(5000)],
    "subscriber": lambda component: component.subscribe("updated", lambda event: 1 / 0),
    "emit-in-a-circle": lambda component: (
        component.subscribe("odd", lambda event: component.emit("odd")) and component.emit("odd")
    ),
    "send-nobody": lambda component: component._surroundings.exchange.send(Message(_agent(component).id, "nobody", {})),
    "send-odd": lambda component: component._surroundings.exchange.send("hello"),
    "no-attributes": lambda component: component.__dict__.clear(),
}

#: Values that a component can return instead of a control input and an intent.
VALUES: dict[str, Any] = {
    "none": lambda: None,
    "text": lambda: "ab",
    "one": lambda: 1.0,
    "nan": lambda: (np.array([np.nan, 0.0]), TimeSeries()),
    "infinite": lambda: ([float("inf"), 0.0], TimeSeries()),
    "complex": lambda: (np.array([1 + 2j, 0]), TimeSeries()),
    "short": lambda: ([1.0], TimeSeries()),
    "matrix": lambda: (np.zeros((2, 2)), TimeSeries()),
    "ragged": lambda: ([[1.0], [1.0, 2.0]], TimeSeries()),
    "objects": lambda: (np.array([object(), None]), TimeSeries()),
    "no-series": lambda: ([0.0, 0.0], [1, 2]),
    "three": lambda: ([0.0, 0.0], TimeSeries(), 3),
    "endless": lambda: itertools.count(),
    "generator": lambda: (each for each in ([0.0, 0.0], TimeSeries())),
    "huge": lambda: (np.zeros(50_000_000), TimeSeries()),
    "integers": lambda: (np.array([2**62, -(2**62)]), TimeSeries()),
    "itself": _itself,
    "type": lambda: Controller,
}

#: The methods in which components misbehave.
WHERE = ("__init__", "check", "initialise", "compute", "update", "random", "series_quantities", "events")


class _Faulty:
    """The base class of the components of this module."""

    class Parameters(Parameters):
        """What to do wrong."""

        act: str = Field("", description="A name of `ACTS`; nothing if empty.")
        value: str = Field("", description="A name of `VALUES` that is returned; nothing wrong if empty.")
        where: str = Field("compute", description="One of `WHERE`.")
        turn: int = Field(1, ge=0, description="At which turn.")

    parameters: Any

    def __init__(self, parameters: Any) -> None:
        self.parameters = parameters
        self.turns = 0
        self._misbehave("__init__")

    def _misbehave(self, where: str) -> None:
        wanted = self.parameters
        due = where in ("__init__", "check", "initialise", "series_quantities") or self.turns == wanted.turn
        if wanted.act and wanted.where == where and due:
            ACTS[wanted.act](self)

    def check(self, group: Any) -> None:
        self._misbehave("check")

    def series_quantities(self, group: Any) -> Any:
        self._misbehave("series_quantities")
        return {}

    def initialise_component(self, *arguments: Any) -> None:
        super().initialise_component(*arguments)  # type: ignore[misc]
        self._misbehave("initialise")

    def _result(self, sound: Any) -> Any:
        self.turns += 1
        self._misbehave("compute")
        wanted = self.parameters
        return VALUES[wanted.value]() if wanted.value and self.turns == wanted.turn else sound


class FaultyController(_Faulty, Controller):  # type: ignore[misc] # whose parameters are those of _Faulty
    """A controller of one agent."""

    def _compute(self) -> Any:
        return self._result(([0.1, 0.0], TimeSeries()))

    def _update(self, value: Any) -> None:
        self._misbehave("update")
        super()._update(value)


class FaultyComponent(_Faulty, Component):  # type: ignore[misc]
    """A component of one agent that waits within its turns, where it may."""

    def _compute(self) -> Any:
        return self._result([0.1, 0.0])

    async def _async_compute(self) -> Any:
        await self.sleep(0.01)
        return self._compute()

    def _update(self, value: Any) -> None:
        self._misbehave("update")
        self._agent.model.control_input = value


class FaultyGroup(_Faulty, GroupComponent):  # type: ignore[misc]
    """A component of a whole group."""

    def _compute(self) -> Any:
        return self._result(np.zeros((len(self.group), 2)))

    def _update(self, value: Any) -> None:
        self._misbehave("update")
        self.group.control_input = value
