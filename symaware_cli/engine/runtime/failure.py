"""The error that ends a run, with the component, plugin and time at fault."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symaware_cli.core import seconds
from symaware_cli.world import describe as describe
from symaware_cli.world import trace


class RunError(Exception):
    """A failure that ends a run.

    Attributes:
        source: The dotted path of the failed part, such as ``agents.robot.2.steer`` or ``environment``.
        plugin: The entry-point name of the plugin that failed.
        time: Simulated time in nanoseconds.
        problem: What happened, in one sentence.
        trace: The traceback, if an exception was the cause.
    """

    def __init__(self, source: str, plugin: str, time: int, problem: str, cause: BaseException | None = None) -> None:
        super().__init__(_recordable(f"{source} ({plugin}) failed at {seconds(time):g} s: {problem}"))
        self.source = source
        self.plugin = plugin
        self.time = time
        self.problem = _recordable(problem)
        self.trace = _recordable(trace(cause)) if cause is not None else ""

    @property
    def data(self) -> Mapping[str, Any]:
        """The data recorded with the event ``failed``."""
        parts = self.source.split(".")
        agent = ".".join(parts[1:-1]) if parts[0] == "agents" else None
        component = parts[-1] if parts[0] == "agents" else None
        return {
            "agent": agent,
            "component": component,
            "plugin": self.plugin,
            "time": seconds(self.time),
            "problem": self.problem,
            "traceback": self.trace,
        }


def _recordable(text: str) -> str:
    """Escape what UTF-8 cannot encode, such as surrogates in a file name."""
    return text.encode("utf-8", "backslashreplace").decode()
