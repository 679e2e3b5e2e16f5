"""Records the beliefs of the agents of a group about others."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, AwarenessDatabase, Roster, Snapshot, Tracks
from symaware_cli.log import others_message
from symaware_cli.log.writer import Message
from symaware_cli.world import SECOND

#: No row changed, and nothing is written.
_NOTHING = (0, b"")


class OthersChannel:
    """The channel `/agents/<group>/awareness`: for each row that changed, all its beliefs of a part."""

    def __init__(self, channel: int, group: AgentGroup, roster: Roster) -> None:
        """Initialise the channel; nothing has been recorded yet.

        Args:
            channel: The number of the open channel.
            group: The group whose beliefs are recorded.
            roster: The roster of all agents.
        """
        self._channel = channel
        self._group = group
        self._roster = roster
        self._last: Tracks | Snapshot | None = None
        #: For each part: the rows whose last record holds a series.
        self._said: defaultdict[str, set[int]] = defaultdict(set)

    def record(self, now: int, own: list[int] | None, messages: list[Message]) -> int:
        """Record the changes of the given rows, None for all, and return the number of rows that changed."""
        if own is not None and not own:
            return 0
        rows, content = self._changed_states(now, own)
        others_changed = self._group.awareness.others_changed
        for part in sorted([part for part, changes in others_changed.items() if changes]):
            changed, series = self._changed_series(part, own)
            rows, content = rows + changed, content + series
        if content:
            messages.append((self._channel, content))
        return rows

    def _changed_states(self, now: int, own: list[int] | None) -> tuple[int, bytes]:
        """Return how many rows have changed beliefs of others' states, and these beliefs, encoded."""
        awareness, count = self._group.awareness, len(self._group)
        tracks, world, changed = awareness.tracks, awareness.world, self._take_changes("state", own)
        shared = world if tracks is None else tracks
        fresh = shared is not None and shared is not self._last
        self._last = shared
        if not awareness.holders:
            if tracks is not None:
                return self._encode_tracks(now, tracks, own) if fresh else _NOTHING
            if world is not None and world.time == now:
                return count, others_message.WHOLE_WORLD
        rows = _recorded(range(count), own) if fresh else changed
        if not rows:
            return _NOTHING
        databases = [agent.awareness_database for agent in self._group.agents]
        if tracks is None and all(each.sees_all(now) for each in databases):
            return count, others_message.WHOLE_WORLD
        return self._encode_rows(now, rows, databases)

    def _take_changes(self, part: str, own: list[int] | None) -> list[int]:
        """Return the rows whose own beliefs changed since the last record, ascending, and reset the changes."""
        changed = self._group.awareness.others_changed[part]
        if not changed:
            return []
        rows = _recorded(sorted(changed), own)
        changed.clear()
        return rows

    def _encode_tracks(self, now: int, tracks: Tracks, own: list[int] | None) -> tuple[int, bytes]:
        """Encode the beliefs that group components hold, for all agents at once."""
        lengths = np.diff(tracks.pointers)
        if own is not None:
            lengths, tracks = lengths[own], tracks.select(np.isin(tracks.observers, own))
        return len(lengths), _encoded(lengths, tracks, tracks.ages + (now - tracks.time) / SECOND, own)

    def _encode_rows(self, now: int, rows: Sequence[int], databases: Sequence[AwarenessDatabase]) -> tuple[int, bytes]:
        """Encode the beliefs of some agents, including those that agents hold separately."""
        tracks = Tracks.joined(now, [databases[row].tracks(now) for row in rows])
        return len(rows), _encoded(np.diff(tracks.pointers), tracks, tracks.ages, rows)

    def _changed_series(self, part: str, own: list[int] | None) -> tuple[int, bytes]:
        """Return how many rows have changed beliefs of a part of others, such as intents, and all of these, encoded."""
        changed, said = self._take_changes(part, own), self._said[part]
        known = {row: self._group.agents[row].awareness_database.held_part(part) for row in changed}
        # An empty belief after an empty one is not recorded.
        rows = [row for row in changed if known[row] or row in said]
        if not rows:
            return _NOTHING
        said.difference_update(rows)
        said.update(row for row in rows if known[row])
        ids, series = [id for row in rows for id in known[row]], [each for row in rows for each in known[row].values()]
        return len(rows), others_message.encode_others_series(
            part,
            [len(known[row]) for row in rows],
            [self._roster.index(id) for id in ids],
            [each.values.shape[1] for each in series],
            [len(each) for each in series],
            np.concatenate([np.empty(0, np.int64), *(each.times for each in series)]),
            np.concatenate([np.empty(0), *(each.values.ravel() for each in series)]),
            rows,
        )


def _recorded(rows: Sequence[int], own: list[int] | None) -> list[int]:
    return list(rows) if own is None else sorted({*rows} & {*own})


def _encoded(lengths: NDArray[np.intp], tracks: Tracks, ages: NDArray[np.float64], rows: Sequence[int] | None) -> bytes:
    return others_message.encode_awareness(
        lengths,
        tracks.others,
        [tracks.motions.shape[1]],
        tracks.motions,
        covariances=() if tracks.covariances is None else tracks.covariances,
        ages=ages if ages.any() else (),
        rows=rows,
    )
