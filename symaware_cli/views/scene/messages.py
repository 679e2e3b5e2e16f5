"""Messages between agents: lines of a text log, and temporary arrows from sender to receiver."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import logged_events
from symaware_cli.views.chunk import Chunk
from symaware_cli.views.detail import FEW, MANY, Detail
from symaware_cli.views.palette import LOSS, MESSAGE
from symaware_cli.views.scene.arrows import BROKEN_POINTS, POINTS, arrows, broken
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Journal, Lines, Points
from symaware_cli.views.views import RunView

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Time for which an arrow is shown [ns], and its transparency at the end of it.
_SEEN = 300_000_000
_FADED = 0.75
#: Interval at which arrows are redrawn, as their ends move [ns]; with many agents, and otherwise.
_CROWD_STEP, _STEP = 100_000_000, 50_000_000
#: Share of the distance at which the arrow of a lost message ends.
_LOSS_AT = 0.45
#: Length of a head in planar and in spatial views, and gap between arrows and points; in widths of the scene.
_HEAD, _ASLANT_HEAD, _GAP = 0.016, 0.025, 0.006
#: Maximum share of the distance that an arrow leaves out at each end.
_OUT = 0.3
#: Maximum length of a message in the text log.
_LONGEST = 240


class Messages(Drawing):
    """Draws messages that are sent, delivered and dropped; arrows follow the agents at their ends until they fade."""

    order: ClassVar = 160

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._number = {agent: number for number, agent in enumerate(run_view.agents)}
        group_views = [
            (group_view, row) for group_view in run_view.group_views.values() for row in range(len(group_view.agents))
        ]
        #: The group of each agent, its row, and its size [m].
        self._groups = np.array([group_view.name for group_view, _ in group_views])
        self._rows = np.array([row for _, row in group_views], np.intp)
        self._sizes = np.array([group_view.extent for group_view, _ in group_views])
        self._step = _STEP if run_view.agent_count <= MANY else _CROWD_STEP
        #: The arrows still shown after the last chunk: time [ns], sender, receiver, whether it was lost; (m, 4).
        self._left = np.empty((0, 4), np.int64)
        #: The number of the last instant at which arrows were drawn.
        self._drawn = -1
        self._width = 0.0

    def marks(self, chunk: Chunk) -> Iterator[Journal | Lines]:
        """Yield the lines of the text log, and the arrows."""
        entries = [
            entry
            for topic in logged_events.MESSAGES
            for time, message in chunk.entries.get(topic, ())
            for entry in logged_events.communications(time, message, self.run_view.roster)
        ]
        entries.sort(key=lambda entry: entry.time)
        yield Journal(
            path="log/messages",
            layer="messages/log",
            times=np.array([entry.time for entry in entries], np.int64),
            kinds=[_stage(entry) for entry in entries],
            sources=[f"{entry.sender} -> {entry.receiver}" for entry in entries],
            texts=[_said(entry) for entry in entries],
            levels=["WARNING" if entry.stage == "DROPPED" else "DEBUG" for entry in entries],
        )
        number = self._number
        ended = [
            (entry.time, number[entry.sender], number[entry.receiver], entry.stage == "DROPPED")
            for entry in entries
            if entry.stage in ("DELIVERED", "DROPPED") and entry.sender in number and entry.receiver in number
        ]
        told = np.concatenate([self._left, np.array(ended, np.int64).reshape(-1, 4)])
        now, drawn = chunk.end // self._step, self._drawn
        first, last = _stays(told, self._step)
        self._left, self._drawn = told[last >= now], now
        begin = np.maximum(first, drawn + 1)
        counts = np.maximum(np.minimum(last, now) - begin + 1, 0)
        which = np.repeat(np.arange(len(told)), counts)
        instants = begin[which] + np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        # When an arrow disappears, an instant without it must be drawn.
        gone = last[(last >= drawn) & (last < now) & (last >= first)] + 1
        yield from self._arrows(np.unique(np.concatenate([instants, gone])), told[which], instants, chunk)

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the marks that are seen, and their meaning."""
        yield "yellow arrows", "messages at delivery"
        yield "red lines that end at a cross", "lost messages"

    def _arrows(self, moments: Integers, told: Integers, instants: Integers, chunk: Chunk) -> Iterator[Lines]:
        """Yield arrows, each at its instant; `moments` and `instants` are counted in steps."""
        if not len(moments):
            return
        order = np.argsort(instants, kind="stable")
        told, instants = told[order], instants[order]
        times = instants * self._step
        origins, targets = (self._ends(told[:, end], times, chunk) for end in (1, 2))
        ways = np.linalg.norm(targets - origins, axis=1)
        known = ways > 0.0  # neither unknown nor the same
        told, instants, times, ways = told[known], instants[known], times[known], ways[known]
        points, lengths = self._lines(told, origins[known], targets[known], ways, self._scene(chunk))
        links, who = np.unique(told[:, 1:3], axis=0, return_inverse=True)
        agents = self.run_view.agents
        yield Lines(
            path="world/messages",
            layer="messages",
            times=moments * self._step,
            counts=np.bincount(np.searchsorted(moments, instants), minlength=len(moments)),
            points=points,
            lengths=lengths,
            colours=np.where(told[:, 3:] > 0, np.array(LOSS, np.uint8), np.array(MESSAGE, np.uint8)),
            transparency=_FADED * (times - told[:, 0]) / _SEEN,
            width=1.0 if self.run_view.agent_count <= FEW else 0.75,
            names=[f"{agents[sender]} {agents[receiver]}" for sender, receiver in links.tolist()],
            who=who.ravel(),
            lasting=_SEEN / 1e9,
            begins=instants == -(-told[:, 0] // self._step),
        )

    def _lines(
        self, told: Integers, origins: Array, targets: Array, ways: Array, scene: float
    ) -> tuple[Array, NDArray[np.int64]]:
        """Return the lines of arrows, between the outlines of the bodies.

        Returns:
            All their points (p, 3) [m], and the number of points of each (m,).
        """
        sizes = self._sizes[told[:, 1:3]]
        if not self.run_view.is_spatial:
            # Just above the bodies, which would hide them.
            lift = 1.1 * sizes.max(axis=1, initial=0.0)[:, None] * [0.0, 0.0, 1.0]
            origins, targets = origins + lift, targets + lift
        out = np.minimum((sizes + _GAP * scene) / ways[:, None], _OUT)
        heads = np.minimum((_ASLANT_HEAD if self.run_view.is_spatial else _HEAD) * scene, 0.3 * ways)
        lost = told[:, 3] > 0
        lengths = np.where(lost, BROKEN_POINTS, POINTS)
        starts = np.cumsum(lengths) - lengths
        points = np.empty((int(lengths.sum()), 3))
        for some, draw, ends in ((~lost, arrows, 1.0 - out[:, 1]), (lost, broken, np.full(len(lost), _LOSS_AT))):
            lines = draw(origins[some], targets[some], out[some, 0], ends[some], heads[some])
            points[starts[some, None] + np.arange(lines.shape[1])] = lines
        return points, lengths

    def _ends(self, agents: Integers, times: Integers, chunk: Chunk) -> Array:
        """Return the positions of agents, each at its time; (m, 3) [m], NaN if unknown."""
        places = np.full((len(agents), 3), np.nan)
        groups = self._groups[agents]
        for name, group_view in self.run_view.group_views.items():
            frames = chunk.frames.get(group_view.state_topic)
            mine = np.flatnonzero(groups == name)
            if frames is not None and len(mine):
                places[mine] = group_view.positions(frames.of(times[mine], self._rows[agents[mine]]))
        return places

    def _scene(self, chunk: Chunk) -> float:
        """Return the width of the scene when the first message is drawn [m]."""
        if not self._width:
            corners = [
                np.empty((0, 3)),
                *(obstacle_view.corners for obstacle_view in self.run_view.obstacle_views.values()),
            ]
            for group_view in self.run_view.group_views.values():
                frames = chunk.frames.get(group_view.state_topic)
                if frames is not None:
                    corners += [group_view.positions(frames.values).reshape(-1, 3), group_view.positions(frames.before)]
            everywhere = np.concatenate(corners)
            everywhere = everywhere[np.isfinite(everywhere).all(axis=1)]
            self._width = float(np.max(np.ptp(everywhere, axis=0))) if len(everywhere) else 0.0
        return self._width


def _stays(told: Integers, step: int) -> tuple[Integers, Integers]:
    """Return the first and last instant of each arrow, in steps; the next arrow of the same link replaces it."""
    times, senders, receivers = told[:, :3].T
    first, last = -(-times // step), -(-(times + _SEEN) // step) - 1
    order = np.lexsort((times, receivers, senders))
    before, after = order[:-1], order[1:]
    again = (senders[before] == senders[after]) & (receivers[before] == receivers[after])
    last[before[again]] = np.minimum(last[before[again]], first[after[again]] - 1)
    return first, last


def _stage(entry: logged_events.Communication) -> str:
    late = f" after {(entry.time - entry.sent_time) / 1e9:g} s" if entry.time > entry.sent_time else ""
    return f"{entry.stage.lower()}{late}" + (f" ({entry.reason})" if entry.reason else "")


def _said(entry: logged_events.Communication) -> str:
    says = f"{entry.kind}  {json.dumps(entry.payload)}" if entry.payload is not None else entry.kind
    return says if len(says) <= _LONGEST else f"{says[: _LONGEST - 1]}…"


#: The event of receiving it, and the entry in its data that names the sender.
_EVENT, _TELLER = "informed", "other"
#: Size of the dots: they hide agents that are drawn as points, which thus change colour [pixels].
_POINT = 4.5
_NEVER = np.iinfo(np.int64).max


class Informed(Drawing):
    """Marks agents from the event ``informed`` on, which components such as gossip emit."""

    order: ClassVar = 170

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

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the marks that are seen, and their meaning."""
        yield "yellow dots", "agents that received a spreading message"
