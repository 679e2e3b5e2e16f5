"""The log reader: `open_log` and `Log`, with the series and the entries that are assembled from messages."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import PARTS, Part, Signal
from symaware_cli.log import logged_events
from symaware_cli.log.error import LogError, UnknownNameError
from symaware_cli.log.fields import signal_topic, signals_of
from symaware_cli.log.index import ChannelInfo
from symaware_cli.log.log_file import LogFile, names_in
from symaware_cli.log.log_message import LogMessage
from symaware_cli.log.logged_beliefs import LoggedBeliefs, beliefs
from symaware_cli.log.logged_events import Communication, LoggedContact, LoggedEvent, LoggedKnowledge
from symaware_cli.log.names import FIELDS, INPUTS, TOPICS
from symaware_cli.log.sensor_channels import (
    IMAGE,
    SCAN,
    LoggedImage,
    LoggedReading,
    LoggedScan,
    images,
    scans,
    sensors,
)
from symaware_cli.log.series import (
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
from symaware_cli.log.specifications import LoggedSpecification, logged, outcome_in, specification_channels

if TYPE_CHECKING:
    import xarray

    from symaware_cli.log.data_frames import FrameLibrary
    from symaware_cli.specification import Outcome

__all__ = ["FIELDS", "Log", "LogMessage", "open_log"]

Sensed = TypeVar("Sensed", bound=LoggedReading)
"""An entry with the reading of a sensor."""


def open_log(path: str | os.PathLike[str]) -> Log:
    """Open a log.

    A log that was cut off or damaged is read as far as possible; `Log.damage` describes what is missing. MCAP files of
    other programs can be opened as well, with `Log.foreign` set: their channels and messages can be listed.

    Args:
        path: The file.

    Returns:
        The log.

    Raises:
        LogError: The file cannot be read: it is missing, not permitted, not an MCAP file, or of a newer format.
    """
    return Log(path)


class Log(LogFile):
    """A log, opened by `open_log`: time series, and iterators over the entries of its journals.

    Attributes:
        foreign: Whether another program wrote it; it then has no manifest and no SymAware messages.
        manifest: The manifest; empty if the log is foreign, or if the manifest is missing or damaged.
    """

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
            table of an agent: one row per entry; the entries of a table share their time (see `tables`).

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
        columns, units = _columns(info)
        if not len(times):
            values = np.empty((*values.shape[:-1], len(columns)))
        elif group in self.agents and "absent" in self.manifest["groups"][group]:
            spans = [self.presence[id] for id in self.agents[group]]
            times, values = gaps(times, values, spans) if row is None else cut(times, values, spans[row])
        return Series(times, values, columns, units)

    def frame(
        self,
        name: str,
        fields: str | Sequence[str] = (),
        *,
        to: FrameLibrary = "pandas",
        start: int | None = None,
        end: int | None = None,
    ) -> Any:
        """Assemble a data frame of series, with one row per instant and agent.

        Args:
            name: A group, an agent, or an entity of the environment.
            fields: One or several fields of `series`; by default those of `world` and `state` that were recorded. A
                field that is a table stands alone, for one agent: one row per entry.
            to: The library: ``pandas``, ``polars`` or ``arrow``.
            start: The first simulated time, ns.
            end: The simulated time at which to stop, exclusive, ns.

        Returns:
            The columns `time` [s], `agent`, and ``FIELD.COLUMN`` for each column of each field, such as ``world.x``,
            with the values of `series`. The rows are in the order of time, then of the agents in their group. A field
            is NaN at instants that only other fields have, and while the agent is absent. Units are in
            ``attrs["units"]`` of pandas and in the metadata ``unit`` of the fields of Arrow; Polars keeps none.

        Raises:
            LogError: The name or a field does not exist, a field is a table and does not stand alone, or the library
                is not installed.
        """
        from symaware_cli.log.data_frames import agent_columns, frame_of, library

        library(to)  # before a long log is read
        return frame_of(agent_columns(*self._framed(name, fields, start, end)), to)

    def to_xarray(
        self, name: str, fields: str | Sequence[str] = (), *, start: int | None = None, end: int | None = None
    ) -> xarray.Dataset:
        """Assemble a dataset of series: a variable for each field over agents, time and columns.

        Args:
            name: See `frame`.
            fields: See `frame`.
            start: See `frame`.
            end: See `frame`.

        Returns:
            The variables, such as ``world``, over `agent`, `time` [s] and `column`, with the values of `series`, NaN as
            in `frame`. Their attribute `units` has the unit of each column. Fields with the same columns share the
            dimension `column`; a field with other columns than the first has its own, ``column_FIELD``.

        Raises:
            LogError: The name or a field does not exist, a field is a table, or xarray is not installed.
        """
        from symaware_cli.log.data_frames import dataset_of, imported

        imported("xarray")
        return dataset_of(*self._framed(name, fields, start, end, with_tables=False))

    def _framed(
        self,
        name: str,
        fields: str | Sequence[str],
        start: int | None,
        end: int | None,
        with_tables: bool = True,
    ) -> tuple[dict[str, Series], Sequence[str]]:
        """Return the series of a frame by field, and the ids of its agents."""
        from symaware_cli.log.data_frames import DEFAULT_FIELDS, between

        group, row, _ = self._locate(name)
        wanted = [fields] if isinstance(fields, str) else list(dict.fromkeys(fields))
        if not wanted:
            recorded = [field for field in DEFAULT_FIELDS if self.series_topic(group, field) in self.topics]
            wanted = recorded or [DEFAULT_FIELDS[0]]
        found = {}
        for field in wanted:
            series = self.series(name, field)
            if self.topics[self.series_topic(group, field)].carries("TableRows"):
                if not with_tables:
                    raise LogError(f"{field} is a table, whose entries share their time: see `tables`")
                if len(wanted) > 1:
                    raise LogError(f"{field} is a table, which has a frame of its own, without other fields")
            found[field] = between(series, start, end)
        if row is not None:
            return found, [name]
        # Without a manifest, the agents are known by their rows only.
        most = max(series.values.shape[1] for series in found.values())
        return found, self.agents.get(group) or [f"{name}[{number}]" for number in range(most)]

    def series_topic(self, owner: str, field: str) -> str:
        """Return the topic of a field of `series` for a group or an entity; it may have no messages.

        Raises:
            UnknownNameError: The field does not exist.
        """
        topics = self._fields(owner)
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
        columns, units = _columns(info)
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
        columns, units = _columns(info)
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

    @cached_property
    def presence(self) -> Mapping[str, tuple[tuple[int, int | None], ...]]:
        """Intervals of time in which each agent was present, by id: start and end, ns; None for the end of the run.

        An agent that never entered has none; most agents are present throughout.
        """
        groups = self.manifest.get("groups", {})
        absent = {id for group in groups.values() for id in group.get("absent", ())}
        spans: dict[str, list[tuple[int, int | None]]] = {
            id: [] if id in absent else [(0, None)] for ids in self.agents.values() for id in ids
        }
        if any("absent" in group for group in groups.values()):
            for event in self.events():
                own = spans.get(event.source.removeprefix("agents."))
                if own is None:
                    continue
                if event.name == "added":
                    own.append((event.time, None))
                elif event.name == "removed" and own:
                    own[-1] = own[-1][0], event.time
        return {id: tuple(own) for id, own in spans.items()}

    def events(self, start: int | None = None, end: int | None = None) -> Iterator[LoggedEvent]:
        """Iterate over the events.

        Args:
            start: The first simulated time, ns.
            end: The simulated time at which to stop, exclusive, ns.
        """
        return self._journal("/events", "Event", logged_events.event, start, end)

    @cached_property
    def inputs(self) -> Mapping[tuple[str, int], Sequence[Mapping[str, Any]]]:
        """The external inputs of components, in order: by the path of the component and the time [ns]."""
        found: dict[tuple[str, int], list[Mapping[str, Any]]] = {}
        for event in self._journal(INPUTS, "Event", logged_events.event, None, None):
            found.setdefault((event.source, event.time), []).append(event.data)
        return found

    def communications(self, start: int | None = None, end: int | None = None) -> Iterator[Communication]:
        """Iterate over the stages of messages between agents; see `events`."""
        roster = self.manifest.get("roster", [])
        for message in self.messages(logged_events.MESSAGES, start, end):
            if message.channel.carries("Message") or message.channel.carries("MessageColumns"):
                with self._readable(message):
                    entries = logged_events.communications(message.time, message.decode(), roster)
                yield from entries

    @cached_property
    def specifications(self) -> Mapping[str, LoggedSpecification]:
        """The specifications that were monitored, by name, in the scenario's order."""
        found = {}
        for name, info in specification_channels(self.channels).items():
            with self._consistent(info.topic):
                found[name] = logged(name, info.metadata, self.messages(info.topic))
        return found

    @cached_property
    def outcomes(self) -> tuple[Outcome, ...]:
        """The outcomes of the specifications that were monitored, in the scenario's order.

        They are those that the run reported at its end; of a log without its end, those in the messages.
        """
        stated = (self.outcome or {}).get("specifications")
        if stated:
            from symaware_cli.specification import Outcome

            return tuple(map(Outcome.from_json, stated))
        if stated is not None:
            return ()
        if not self.specifications:
            return ()
        told = [event for event in self.events() if event.source.startswith("specifications.")]
        with self._consistent("/events"):
            return tuple(outcome_in(each, told) for each in self.specifications.values())

    def contacts(self, start: int | None = None, end: int | None = None) -> Iterator[LoggedContact]:
        """Iterate over the beginnings and ends of contacts; see `events`."""
        return self._journal("/contacts", "Contact", logged_events.contact, start, end)

    def scans(self, name: str | None = None, start: int | None = None, end: int | None = None) -> Iterator[LoggedScan]:
        """Iterate over the scans of lidars, one for each agent and turn.

        Args:
            name: An agent or a group; None for all.
            start: The first simulated time, ns.
            end: The simulated time at which to stop, exclusive, ns.

        Raises:
            LogError: The name does not exist.
        """
        return self._sensed(SCAN, "Scan", scans, name, start, end)

    def images(
        self, name: str | None = None, start: int | None = None, end: int | None = None
    ) -> Iterator[LoggedImage]:
        """Iterate over the images of cameras: colour, depth and segmentation; see `scans`."""
        return self._sensed(IMAGE, "Image", images, name, start, end)

    def _sensed(
        self,
        word: str,
        message_name: str,
        entries: Callable[[int, Any, str, Sequence[str]], Iterable[Sensed]],
        name: str | None,
        start: int | None,
        end: int | None,
    ) -> Iterator[Sensed]:
        group, row, _ = (None, None, 0) if name is None else self._locate(name)
        topics = {
            topic: (sensor, agents)
            for each, agents in self.agents.items()
            for sensor, topic in sensors(self.channels, each, word).items()
            if group in (None, each) and self.channels[topic].carries(message_name)
        }
        messages = self.messages(topics, start, end)
        return self._readings(messages, topics, entries, None if row is None else name)

    def _readings(
        self,
        messages: Iterable[LogMessage],
        topics: Mapping[str, tuple[str, Sequence[str]]],
        entries: Callable[[int, Any, str, Sequence[str]], Iterable[Sensed]],
        agent: str | None,
    ) -> Iterator[Sensed]:
        for message in messages:
            with self._readable(message):
                made = entries(message.time, message.decode(), *topics[message.channel.topic])
            yield from (entry for entry in made if agent in (None, entry.agent))

    def knowledge(self, name: str | None = None) -> Iterator[LoggedKnowledge]:
        """Iterate over the knowledge of agents: an entry at the beginning, and one after each change.

        Args:
            name: An agent or a group; None for all.

        Raises:
            LogError: The name does not exist.
        """
        groups = {f"/agents/{group}/knowledge": agents for group, agents in self.agents.items()}
        wanted: str | None = None
        if name is not None:
            group, row, _ = self._locate(name)
            topic = f"/agents/{group}/knowledge"
            wanted = None if row is None else name
            groups = {topic: groups.get(topic, ())}
        return self._knowledge(groups, wanted)

    def _knowledge(self, groups: Mapping[str, Sequence[str]], agent: str | None) -> Iterator[LoggedKnowledge]:
        for message in self.messages(groups):
            topic = message.channel.topic
            if not message.channel.carries("Knowledge"):
                continue
            with self._consistent(topic):
                entries = logged_events.knowledge(message.time, message.decode(), groups[topic])
            yield from (entry for entry in entries if agent in (None, entry.agent))

    def _journal(
        self, topic: str, message_name: str, entry: Callable[[int, Any], Any], start: int | None, end: int | None
    ) -> Iterator[Any]:
        for message in self.messages(topic, start, end):
            if message.channel.carries(message_name):
                with self._readable(message):
                    made = entry(message.time, message.decode())
                yield made

    @contextmanager
    def _readable(self, message: LogMessage) -> Iterator[None]:
        try:
            yield
        except ValueError as error:
            place = f"on {message.channel.topic} at {message.time} ns in {self.path}"
            raise LogError(f"the entry {place} is damaged: {error}") from error


def _columns(info: ChannelInfo) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names and the units of the columns of a channel."""
    return names_in(info.metadata.get("columns", "")), names_in(info.metadata.get("units", ""))
