"""Agents informed by a spreading message: a dot on each agent that received it, or sent it to others."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from symaware_cli.recording import logged_events
from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.palette import MESSAGE
from symaware_cli.viewing.scene.marks import Points
from symaware_cli.viewing.scene.scene import Drawing
from symaware_cli.viewing.views import RunView

#: The event of receiving it, and the entry in its data that names the sender.
_EVENT, _TELLER = "informed", "other"
#: Size of the dots: they hide agents that are drawn as points, which thus change colour [pixels].
_POINT = 4.5
_NEVER = np.iinfo(np.int64).max


class Informed(Drawing):
    """Marks agents from the event ``informed`` on, which components such as gossip emit."""

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._since = {
            name: np.full(len(group_view.agents), _NEVER) for name, group_view in run_view.group_views.items()
        }

    def marks(self, chunk: Chunk) -> Iterator[Points]:
        """Yield a dot on each agent that is informed."""
        moments = []
        for time, message in chunk.entries.get("/events", ()):
            if message.name == _EVENT:
                event = logged_events.event(time, message)
                # The source of the event is a component: agents.<agent>.<component>.
                told = event.source.removeprefix("agents.").rpartition(".")[0]
                for agent in (told, event.data.get(_TELLER)):
                    if isinstance(agent, str) and agent in self.run_view.place:
                        group, row = self.run_view.place[agent]
                        self._since[group][row] = min(self._since[group][row], time)
                moments.append(time)
        for name, group_view in self.run_view.group_views.items():
            since, frames = self._since[name], chunk.frames.get(group_view.state_topic)
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
