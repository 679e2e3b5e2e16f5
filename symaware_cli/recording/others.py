"""The channel of what the agents of a group believe of others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from symaware_cli.core import AgentGroup, AwarenessDatabase, Roster, Snapshot, Tracks
from symaware_cli.core.time import SECOND
from symaware_cli.recording import wire
from symaware_cli.recording.rows import RecordedRows
from symaware_cli.recording.writer import LogWriter


class OthersChannel:
    """`/agents/<group>/awareness`."""

    def __init__(self, writer: LogWriter, channel: int, group: AgentGroup, roster: Roster, rows: RecordedRows) -> None:
        """Begin with nothing recorded.

        Args:
            writer: The log.
            channel: The channel, opened.
            group: Whose beliefs.
            roster: Who there is.
            rows: Which rows are recorded.
        """
        self._writer = writer
        self._channel = channel
        self._group = group
        self._roster = roster
        self._rows = rows
        self._last_tracks: Tracks | None = None
        self._last_world: Snapshot | None = None

    def record(self, now: int) -> int:
        """Record what changed and return how many rows of the group that were."""
        awareness, own = self._group.awareness, self._rows.now
        if own is not None and not own:
            return 0
        changed, tracks, world = awareness.others_changed, awareness.tracks, awareness.world
        if not changed and tracks is not None:
            return self._record_tracks(now, tracks, own)
        if not changed and world is not None and world.time == now:
            self._last_world = world
            self._writer.add(self._channel, now, wire.WHOLE_WORLD)
            return len(self._group)
        if not changed and world is not self._last_world:
            # The world as it was: /world at this instant does not tell it.
            changed = set(range(len(self._group)))
        self._last_world = world
        if changed:
            awareness.others_changed = set()
        if own is not None:
            changed = changed & {*own}
        if not changed:
            return 0
        databases = [agent.awareness_database for agent in self._group.agents]
        if all(each.world is not None and each.world.time == now and not each.others for each in databases):
            self._writer.add(self._channel, now, wire.WHOLE_WORLD)
            return len(self._group)
        return self._record_databases(now, sorted(changed), databases)

    def _record_tracks(self, now: int, tracks: Tracks, own: list[int] | None) -> int:
        """Record what the group's perception believes of others, for all agents at once."""
        if tracks is self._last_tracks:
            return 0
        self._last_tracks = tracks
        lengths = np.diff(tracks.pointers)
        if own is not None:
            lengths, tracks = lengths[own], tracks.select(np.isin(tracks.observers, own))
        values = np.concatenate([tracks.positions, tracks.velocities], axis=1)
        ages = tracks.ages + (now - tracks.time) / SECOND
        encoded = wire.encode_awareness(
            lengths,
            tracks.others,
            [values.shape[1]],
            values,
            covariances=() if tracks.covariances is None else tracks.covariances,
            ages=ages if ages.any() else (),
            rows=own,
        )
        self._writer.add(self._channel, now, encoded)
        return len(lengths)

    def _record_databases(self, now: int, rows: Sequence[int], databases: Sequence[AwarenessDatabase]) -> int:
        """Record what the components of single agents know of others."""
        roster = self._roster
        lengths, entities, columns, values = [], [], [], [np.empty(0)]
        for row in rows:
            database = databases[row]
            others = [id for id in database if id != self._group.ids[row] and id in roster]
            lengths.append(len(others))
            for id in others:
                state = database[id].state
                entities.append(roster.index(id))
                columns.append(len(state))
                values.append(state)
        encoded = wire.encode_awareness(lengths, entities, columns, np.concatenate(values), rows)
        self._writer.add(self._channel, now, encoded)
        return len(rows)
