"""What happened: events as lines of a log, and the modes that agents are in."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

from symaware_cli.recording import logged_events
from symaware_cli.recording.json_text import read_json
from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.rerun_output import RerunOutput
from symaware_cli.viewing.views import RunView

_LEVELS = {"DEBUG": "DEBUG", "INFO": "INFO", "WARNING": "WARN", "ERROR": "ERROR"}


class _Modes(Drawing):
    """What says from when on somebody is in which mode."""

    def _write(self, changes: list[tuple[str, int, str]]) -> None:
        """Write down changes of modes: path, time [ns] and mode, each path's in the order of time."""
        found: defaultdict[str, list[tuple[int, str]]] = defaultdict(list)
        for path, time, mode in changes:
            found[path].append((time, mode))
        for path, told in found.items():
            self.output.modes(f"modes/{path}", [time for time, _ in told], [mode for _, mode in told])


class Events(_Modes):
    """The events as a log; those of each agent in focus also as what it did last."""

    def draw(self, chunk: Chunk) -> None:
        """Write the events."""
        events = [logged_events.event(time, message) for time, message in chunk.entries.get("/events", ())]
        self.output.texts(
            "log/events",
            [event.time for event in events],
            [f"{event.time / 1e9:8.2f} s  {event.name}  {event.source}  {event.text}".rstrip() for event in events],
            [_LEVELS.get(event.level, "INFO") for event in events],
        )
        # The source of an event is a component: agents.<agent>.<component>.
        focus = {f"agents.{agent}": agent for agent in self.detail.focus}
        sources = [(focus.get(event.source.rpartition(".")[0]), event) for event in events]
        self._write([(agent, event.time, event.name) for agent, event in sources if agent])


class Knowledge(_Modes):
    """What agents know that is a mode: words and yes or no, over time."""

    def __init__(self, run_view: RunView, detail: Detail, output: RerunOutput) -> None:
        super().__init__(run_view, detail, output)
        self._known: dict[str, str] = {}

    def draw(self, chunk: Chunk) -> None:
        """Write down what changed."""
        changes = []
        for group_view in self.run_view.group_views.values():
            focus = {row: agent for row, agent in enumerate(group_view.agents) if agent in self.detail.focus}
            for time, message in chunk.entries.get(f"/agents/{group_view.name}/knowledge", ()):
                for row, value in zip(message.rows or range(len(message.values)), message.values, strict=True):
                    if row in focus:
                        changes += [(path, time, mode) for path, mode in self._changed(focus[row], read_json(value))]
        self._write(changes)

    def _changed(self, agent: str, knowledge: dict[str, Any]) -> list[tuple[str, str]]:
        modes = {f"{agent}/{name}": str(value) for name, value in knowledge.items() if isinstance(value, str | bool)}
        changed = [(path, mode) for path, mode in modes.items() if self._known.get(path) != mode]
        self._known |= modes
        return changed
