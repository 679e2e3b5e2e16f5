"""Values over time, read from a log: states, inputs, parts of awareness, signals, and what is believed of others."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import PARTS, Part, Signal
from symaware_cli.recording.error import LogError, UnknownNameError
from symaware_cli.recording.fields import signal_topic, signals_of
from symaware_cli.recording.index import ChannelInfo
from symaware_cli.recording.log_file import names_in
from symaware_cli.recording.log_journals import LogJournals
from symaware_cli.recording.logged_beliefs import LoggedBeliefs, beliefs
from symaware_cli.recording.names import TOPICS
from symaware_cli.recording.series import (
    LoggedTable,
    Prediction,
    Series,
    cut,
    gaps,
    group_series,
    place_of,
    present_values,
    row_series,
)


class LogSeries(LogJournals):
    """The series of a log, put together from its messages."""

    def series(self, name: str, field: str) -> Series:
        """Put a series together.

        Args:
            name: A group, an agent, or an entity of the environment. The name of a group of one is its agent's.
            field: `state` (what they believe), `world` (what is true), `pose` and `joints` (the rest of that, in worlds
                of space); `control` (what the world applied in the step that ended then), `control_requested` (what
                was asked for from then on); a part of awareness, such as `intent`, `uncertainty` and `risk`, of which
                the first point is taken where it is a time series; or a signal, by its component and its name, such as
                `radar.returns`, and a sensor that measures a few numbers by its name alone: from when they became
                known, NaN where it missed them.

        Returns:
            For a group every instant at which any of its agents was recorded, (k, n, columns), where the others keep
            their value (NaN before the first, and while they are not in the world); for an agent or an entity the
            instants at which it was recorded, (k, columns), with NaN at the one at which it left the world. Of entities
            only those that move were recorded. Of the table of an agent each entry by itself, at the same time as the
            others of it (see `tables`).

        Raises:
            LogError: There is no such name or field, or it is a table and the name that of a group.
        """
        group, row, count = self._place(name)
        topic, known = self.series_topic(group, field), self._fields(group)
        there = sorted(other for other in known if known[other] in self.topics)
        what = f"{field} of {name!r}"
        info = self._channel(topic, what, "Rows", "SeriesRows", "TableRows", instead=there)
        if info.carries("TableRows"):
            return self._entries(info, name)
        entries = ((message.time, *present_values(message.decode(), count)) for message in self.messages(info.topic))
        with self._fitting(info.topic):
            times, values = group_series(entries, count) if row is None else row_series(entries, row)
        columns, units = (names_in(info.metadata.get(key, "")) for key in ("columns", "units"))
        if not len(times):
            values = np.empty((*values.shape[:-1], len(columns)))
        elif group in self.agents and "absent" in self.manifest["groups"][group]:
            spans = [self.presence[id] for id in self.agents[group]]
            times, values = gaps(times, values, spans) if row is None else cut(times, values, spans[row])
        return Series(times, values, columns, units)

    def series_topic(self, owner: str, field: str) -> str:
        """Return the topic of a field of `series`, of a group or an entity; nothing may have been recorded on it.

        Raises:
            UnknownNameError: There is no such field.
        """
        topics = self._fields(owner)
        if field not in topics:
            there = ", ".join(sorted(topics))
            raise UnknownNameError(f"there is no field {field!r}; there are {there}", field, sorted(topics))
        return topics[field]

    def _fields(self, owner: str) -> dict[str, str]:
        """The topics of all fields of a group or an entity, whether or not the log has them."""
        # A sensor that is called as a field is hidden by it.
        fields = {name: template.format(owner) for name, template in TOPICS.items()}
        return {name: signal_topic(owner, name, each) for name, each in self.signals(owner).items()} | fields

    def signals(self, group: str) -> dict[str, Signal]:
        """What there are channels of in a group: parts of awareness by name, then signals by component and name."""
        return signals_of(self.channels, group)

    def parts(self, group: str) -> dict[str, Part]:
        """The parts of awareness of a group that there are channels of, by name: first those of every group."""
        return {name: each for name, each in self.signals(group).items() if isinstance(each, Part)}

    def tables(self, agent: str, field: str) -> Iterator[LoggedTable]:
        """Iterate over the tables that a component handed out of an agent, whole, at each instant at which it did.

        Args:
            agent: Its id.
            field: The signal, by its component and name, such as `radar.returns`.

        Raises:
            LogError: There is no such agent or field, or it is no table.
        """
        group, row, _ = self._agent(agent)
        info = self._channel(self.series_topic(group, field), f"{field} of {agent!r}", "TableRows")
        columns, units = (names_in(info.metadata.get(key, "")) for key in ("columns", "units"))
        return self._tables(info.topic, row, columns, units)

    def _tables(self, topic: str, row: int, columns: tuple[str, ...], units: tuple[str, ...]) -> Iterator[LoggedTable]:
        for message in self.messages(topic):
            content = message.decode()
            place = place_of(row, content.rows)
            if place is not None:
                # A copy, so that one row does not keep the whole message in memory.
                yield LoggedTable(message.time, content.at(place).copy(), columns, units)

    def _entries(self, info: ChannelInfo, name: str) -> Series:
        """The entries of the tables of an agent, one after the other."""
        _, row, _ = self._agent(name)
        columns, units = (names_in(info.metadata.get(key, "")) for key in ("columns", "units"))
        tables = list(self._tables(info.topic, row, columns, units))
        times = np.repeat(np.array([table.time for table in tables], np.int64), [len(table.values) for table in tables])
        values = np.concatenate([np.empty((0, len(columns))), *(table.values for table in tables)])
        return Series(times, values, columns, units)

    def predictions(self, agent: str, field: str) -> Iterator[Prediction]:
        """Iterate over what an agent expected: the whole of its time series at each instant at which it set one.

        Args:
            agent: Its id.
            field: What is a time series: `intent`, `uncertainty`, `risk`, or a part or signal of a plugin.
                `series` names the columns.

        Raises:
            LogError: There is no such agent or field.
        """
        group, row, _ = self._agent(agent)
        signals: dict[str, Signal] = {part.name: part for part in PARTS} | self.signals(group)
        predicted = [name for name, signal in signals.items() if signal.kind == "series"]
        if field not in predicted:
            message = f"there is no field {field!r} of predictions; there are {', '.join(predicted)}"
            raise UnknownNameError(message, field, predicted)
        topic = self._channel(signal_topic(group, field, signals[field]), f"{field} of {agent!r}", "SeriesRows").topic
        return self._predictions(topic, row)

    def _predictions(self, topic: str, row: int) -> Iterator[Prediction]:
        for message in self.messages(topic):
            content = message.decode()
            place = place_of(row, content.rows)
            if place is not None:
                times, values = content.at(place)
                # Copies, so that one row does not keep the whole message in memory.
                yield Prediction(message.time, times[: len(values)].copy(), values.copy())

    def beliefs(self, agent: str, other: str) -> LoggedBeliefs:
        """Put together what an agent believed of another.

        That is its position and velocity, whoever perceived it. Whoever knows the whole world knows the truth of that
        instant; a velocity that is no part of a true state is not in the log then, and NaN.

        Args:
            agent: Whose beliefs.
            other: Whom they are about.

        Returns:
            Every instant at which the agent's awareness was recorded, with covariances and ages, (k, columns); and what
            it knew of the other's intent, uncertainty and risk.

        Raises:
            LogError: There is no such agent, or nothing was recorded of its awareness.
        """
        group, row, count = self._agent(agent)
        other_group, _, _ = self._agent(other)
        roster = self.manifest.get("roster", [])
        if agent == other or other not in roster:
            raise LogError(f"{self.path} has no beliefs of {agent!r} about {other!r}")
        topic = self._channel(f"/agents/{group}/awareness", f"awareness of {agent!r}", "Awareness").topic

        models = [each.get("model", {}) for each in self.manifest["groups"].values()]
        dimensions = max((len(model.get("position", (0, 1))) for model in models), default=2)

        @cache
        def world() -> Series:
            series, model = self.series(other, "world"), self.manifest["groups"][other_group].get("model", {})
            names = [name for name, _ in model.get("state", ())]
            columns = np.full((len(series.times), 2 * dimensions), np.nan)
            columns[:, :dimensions] = 0.0  # who moves in the plane stands at height 0
            for axis, place in enumerate(model.get("position", (0, 1))):
                columns[:, axis] = series.values[:, place]
                if f"velocity_{names[place]}" in names:
                    columns[:, dimensions + axis] = series.values[:, names.index(f"velocity_{names[place]}")]
            return Series(series.times, columns)

        def truth(time: int) -> NDArray[np.float64]:
            number = int(np.searchsorted(world().times, time, side="right"))
            return world().values[number - 1] if number else np.full(2 * dimensions, np.nan)

        with self._fitting(topic):
            return beliefs(
                ((message.time, message.decode()) for message in self.messages(topic)),
                row,
                count,
                roster.index(other),
                truth,
            )
