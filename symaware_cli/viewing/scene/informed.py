"""Who knows what is told around: a dot on everybody who was told, or told others."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from symaware_cli.recording import logged_events
from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.palette import MESSAGE
from symaware_cli.viewing.scene.base import Drawing
from symaware_cli.viewing.scene.marks import Points
from symaware_cli.viewing.views import RunView

#: The event that says so, and what in its data names who told it.
_EVENT, _TELLER = "informed", "other"
#: How large the dots are: those who are points themselves are hidden by them, and so change their colour [pixels].
_POINT = 4.5
_NEVER = np.iinfo(np.int64).max


class Informed(Drawing):
    """Marks agents from the event ``informed`` on, as gossip records it."""

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._since = {
            name: np.full(len(group_view.agents), _NEVER) for name, group_view in run_view.group_views.items()
        }

    def marks(self, chunk: Chunk) -> Iterator[Points]:
        """A dot on each of those who know by then."""
        moments = []
        for time, message in chunk.entries.get("/events", ()):
            if message.name == _EVENT:
                event = logged_events.event(time, message)
                # The source of an event is a component: agents.<agent>.<component>.
                told = event.source.removeprefix("agents.").rpartition(".")[0]
                for agent in (told, event.data.get(_TELLER)):
                    if isinstance(agent, str) and agent in self.run_view.place:
                        group, row = self.run_view.place[agent]
                        self._since[group][row] = min(self._since[group][row], time)
                moments.append(time)
        for name, group_view in self.run_view.group_views.items():
            since, frames = self._since[name], chunk.frames.get(group_view.whereabouts)
            if frames is None or (since == _NEVER).all():
                continue
            times = np.union1d(frames.times, np.array(moments, np.int64))
            # Above the bodies, which would hide them.
            places = group_view.positions(frames.at(times)) + np.array([0.0, 0.0, 1.1 * group_view.extent])
            places[since > times[:, None]] = np.nan
            yield Points(
                path=f"world/agents/{name}/informed",
                layer=f"informed/{name}",
                times=times,
                counts=[len(since)] * len(times),
                positions=places.reshape(-1, 3),
                colours=MESSAGE,
                size=_POINT,
                names=group_view.agents,
                who=np.tile(np.arange(len(since)), len(times)),
            )
