"""Reads time series from a log: states, control inputs, parts of awareness, signals, and beliefs about others."""

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
from symaware_cli.recording.names import FORMER_FIELDS, TOPICS
from symaware_cli.recording.series import (
    LoggedTable,
    Prediction,
    Series,
    cut,
    gaps,
    group_series,
    present_values,
    row_position,
    row_series,
)


class LogSeries(LogJournals):
    """A log with methods that assemble series from its messages."""

    def series(self, name: str, field: str) -> Series:
        """Assemble a series.

        Args:
            name: A group, an agent, or an entity of the environment. The name of a group of one is also that of its
                agent.
            field: `state` (believed), `world` (true), `pose` and `joints` (further true quantities in spatial worlds);
                `applied_control` (the input that the world applied in the step that ended at that time),
                `requested_control` (the input requested from that time on); a part of awareness, such as `intent`,
                `uncertainty` and `risk`, of which the first point is used if it is a time series; or a signal, by
                component and name, such as `radar.returns`, or by component alone for a sensor that measures a vector:
                from the time it became available, NaN where a measurement was missed.

        Returns:
            For a group: every instant at which any of its agents was recorded, (k, n, columns); the other agents keep
            their values (NaN before the first, and while absent). For an agent or an entity: the instants at which it
            was recorded, (k, columns), with NaN when it left the world. Only moving entities are recorded. For the
            table of an
            agent: one row per entry; the entries of a table share their time (see `tables`).

        Raises:
            LogError: The name or field does not exist, or the field is a table and the name is that of a group.
        """
        group, row, count = self._locate(name)
        topic, known = self.series_topic(group, field), self._fields(group)
        there = sorted(other for other in known if known[other] in self.topics)
        what = f"{field} of {name!r}"
        info = self._channel(topic, what, "Rows", "SeriesRows", "TableRows", instead=there)
        if info.carries("TableRows"):
            return self._entries(info, name)
        entries = ((message.time, *present_values(message.decode(), count)) for message in self.messages(info.topic))
        with self._consistent(info.topic):
            times, values = group_series(entries, count) if row is None else row_series(entries, row)
        columns, units = (names_in(info.metadata.get(key, "")) for key in ("columns", "units"))
        if not len(times):
            values = np.empty((*values.shape[:-1], len(columns)))
        elif group in self.agents and "absent" in self.manifest["groups"][group]:
            spans = [self.presence[id] for id in self.agents[group]]
            times, values = gaps(times, values, spans) if row is None else cut(times, values, spans[row])
        return Series(times, values, columns, units)

    def series_topic(self, owner: str, field: str) -> str:
        """Return the topic of a field of `series` for a group or an entity; it may have no messages.

        Raises:
            UnknownNameError: The field does not exist.
        """
        topics, field = self._fields(owner), FORMER_FIELDS.get(field, field)
        if field not in topics:
            there = ", ".join(sorted(topics))
            raise UnknownNameError(f"there is no field {field!r}; there are {there}", field, sorted(topics))
        return topics[field]

    def _fields(self, owner: str) -> dict[str, str]:
        """Return the topics of all possible fields of a group or an entity, whether or not the log has them."""
        # A built-in field hides a sensor of the same name.
        fields = {name: template.format(owner) for name, template in TOPICS.items()}
        return {name: signal_topic(owner, name, each) for name, each in self.signals(owner).items()} | fields

    def signals(self, group: str) -> dict[str, Signal]:
        """Return the parts and signals of a group that have channels: parts by name, signals by component and name."""
        return signals_of(self.channels, group)

    def parts(self, group: str) -> dict[str, Part]:
        """Return the parts of awareness of a group that have channels, by name: built-in parts first."""
        return {name: each for name, each in self.signals(group).items() if isinstance(each, Part)}

    def tables(self, agent: str, field: str) -> Iterator[LoggedTable]:
        """Iterate over the tables of a signal of an agent, each at the instant at which the component produced it.

        Args:
            agent: The id of the agent.
            field: The signal, by component and name, such as `radar.returns`.

        Raises:
            LogError: The agent or field does not exist, or the field is not a table.
        """
        group, row, _ = self._locate_agent(agent)
        info = self._channel(self.series_topic(group, field), f"{field} of {agent!r}", "TableRows")
        columns, units = (names_in(info.metadata.get(key, "")) for key in ("columns", "units"))
        return self._tables(info.topic, row, columns, units)

    def _tables(self, topic: str, row: int, columns: tuple[str, ...], units: tuple[str, ...]) -> Iterator[LoggedTable]:
        for message in self.messages(topic):
            content = message.decode()
            place = row_position(row, content.rows)
            if place is not None:
                # A copy, so that one row does not keep the whole message in memory.
                yield LoggedTable(message.time, content.at(place).copy(), columns, units)

    def _entries(self, info: ChannelInfo, name: str) -> Series:
        """Return the concatenated entries of the tables of an agent."""
        _, row, _ = self._locate_agent(name)
        columns, units = (names_in(info.metadata.get(key, "")) for key in ("columns", "units"))
        tables = list(self._tables(info.topic, row, columns, units))
        times = np.repeat(np.array([table.time for table in tables], np.int64), [len(table.values) for table in tables])
        values = np.concatenate([np.empty((0, len(columns))), *(table.values for table in tables)])
        return Series(times, values, columns, units)

    def predictions(self, agent: str, field: str) -> Iterator[Prediction]:
        """Iterate over the predictions of an agent: the whole time series at each instant at which it was set.

        Args:
            agent: The id of the agent.
            field: A time series: `intent`, `uncertainty`, `risk`, or a part or signal of a plugin. `series` names the
                columns.

        Raises:
            LogError: The agent or field does not exist.
        """
        group, row, _ = self._locate_agent(agent)
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
            place = row_position(row, content.rows)
            if place is not None:
                times, values = content.at(place)
                # Copies, so that one row does not keep the whole message in memory.
                yield Prediction(message.time, times[: len(values)].copy(), values.copy())

    def beliefs(self, agent: str, other: str) -> LoggedBeliefs:
        """Assemble the beliefs of an agent about another: position and velocity, whichever component perceived them.

        For an agent that knows the whole world, the belief is the truth at that instant; a velocity that is not part of
        the true state is not in the log and is NaN.

        Args:
            agent: The agent that believes.
            other: The agent that the beliefs are about.

        Returns:
            Every instant at which the agent's awareness was recorded, with covariances and ages, (k, columns); and its
            knowledge of the other's intent, uncertainty and risk.

        Raises:
            LogError: An agent does not exist, or the awareness was not recorded.
        """
        group, row, count = self._locate_agent(agent)
        other_group, _, _ = self._locate_agent(other)
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
            columns[:, :dimensions] = 0.0  # agents in the plane are at height 0
            for axis, place in enumerate(model.get("position", (0, 1))):
                columns[:, axis] = series.values[:, place]
                if f"velocity_{names[place]}" in names:
                    columns[:, dimensions + axis] = series.values[:, names.index(f"velocity_{names[place]}")]
            return Series(series.times, columns)

        def truth(time: int) -> NDArray[np.float64]:
            number = int(np.searchsorted(world().times, time, side="right"))
            return world().values[number - 1] if number else np.full(2 * dimensions, np.nan)

        with self._consistent(topic):
            return beliefs(
                ((message.time, message.decode()) for message in self.messages(topic)),
                row,
                count,
                roster.index(other),
                truth,
            )
