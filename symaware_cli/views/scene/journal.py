"""Events as lines of a text log, and the modes of agents over time."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Any, ClassVar

import numpy as np

from symaware_cli.log import logged_events, read_json
from symaware_cli.views.chunk import Chunk
from symaware_cli.views.detail import Detail
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Journal, Modes
from symaware_cli.views.views import RunView


class Events(Drawing):
    """Draws events as a text log, and the last event of each agent in focus as its mode."""

    outputs: ClassVar = frozenset({"replay", "foxglove", "plot"})
    order: ClassVar = 200

    def marks(self, chunk: Chunk) -> Iterator[Journal | Modes]:
        """Yield the lines, and the modes."""
        events = [logged_events.event(time, message) for time, message in chunk.entries.get("/events", ())]
        yield Journal(
            path="log/events",
            layer="events",
            times=np.array([event.time for event in events], np.int64),
            kinds=[event.name for event in events],
            sources=[event.source for event in events],
            texts=[event.text for event in events],
            levels=[event.level for event in events],
        )
        # The source of an event of an agent is a component: agents.<agent>.<component>.
        focus = {f"agents.{agent}": agent for agent in self.detail.focus}
        sources = [(focus.get(event.source.rpartition(".")[0]), event) for event in events]
        yield from _modes([(agent, event.time, event.name) for agent, event in sources if agent])


class Knowledge(Drawing):
    """Draws texts and truth values in the knowledge of agents as modes over time."""

    outputs: ClassVar = frozenset({"replay", "foxglove", "plot"})
    order: ClassVar = 210

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._known: dict[str, str] = {}

    def marks(self, chunk: Chunk) -> Iterator[Modes]:
        """Yield the changes for each agent in focus."""
        changes = []
        for group_view in self.run_view.group_views.values():
            focus = {row: agent for row, agent in enumerate(group_view.agents) if agent in self.detail.focus}
            for time, message in chunk.entries.get(f"/agents/{group_view.name}/knowledge", ()):
                for row, value in zip(message.rows or range(len(message.values)), message.values, strict=True):
                    if row in focus:
                        changes += [(path, time, mode) for path, mode in self._changed(focus[row], read_json(value))]
        yield from _modes(changes)

    def _changed(self, agent: str, knowledge: dict[str, Any]) -> list[tuple[str, str]]:
        modes = {f"{agent}/{name}": str(value) for name, value in knowledge.items() if isinstance(value, str | bool)}
        changed = [(path, mode) for path, mode in modes.items() if self._known.get(path) != mode]
        self._known |= modes
        return changed


def _modes(changes: Iterable[tuple[str, int, str]]) -> Iterator[Modes]:
    """Yield a mark for each path from changes: path, time [ns] and mode, ordered by time for each path."""
    found: defaultdict[str, list[tuple[int, str]]] = defaultdict(list)
    for path, time, mode in changes:
        found[path].append((time, mode))
    for path, told in found.items():
        times = np.array([time for time, _ in told], np.int64)
        yield Modes(path=f"modes/{path}", times=times, modes=[mode for _, mode in told])
