"""The reader of a log."""

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import PARTS, Part
from symaware_cli.recording import journal
from symaware_cli.recording.beliefs import Beliefs, beliefs
from symaware_cli.recording.error import LogError, UnknownNameError
from symaware_cli.recording.fields import PART_MESSAGES, part_of, parts_of
from symaware_cli.recording.index import ChannelInfo
from symaware_cli.recording.journal import Communication, LoggedContact, LoggedEvent, LoggedKnowledge
from symaware_cli.recording.manifest import read_manifest
from symaware_cli.recording.mcap_file import McapFile
from symaware_cli.recording.message import LogMessage
from symaware_cli.recording.names import FIELDS, TOPICS
from symaware_cli.recording.recovery import Damage
from symaware_cli.recording.schema import FORMAT, MANIFEST, OUTCOME, PROFILE, RECOVERY, TIMING
from symaware_cli.recording.sensing import (
    IMAGE,
    MEASUREMENT,
    SCAN,
    LoggedImage,
    LoggedReading,
    LoggedScan,
    images,
    scans,
    sensors,
)
from symaware_cli.recording.series import (
    Prediction,
    Series,
    cut,
    gaps,
    group_series,
    place_of,
    present_values,
    row_series,
)
from symaware_cli.recording.shared import SHARED, SharedChannel, entities_of, shared

__all__ = ["FIELDS", "Log", "LogMessage", "open_log"]

_MESSAGES = {
    "/agents//control": "Rows",
    "/agents//awareness": "Awareness",
    "/agents//knowledge": "Knowledge",
    f"/agents//{MEASUREMENT}/": "Rows",
    f"/agents//{SCAN}/": "Scan",
    f"/agents//{IMAGE}/": "Image",
    "/world//state": "Rows",
    "/world//pose": "Rows",
    "/world//joints": "Rows",
    **dict.fromkeys(SHARED, "Rows"),
    "/world//control": "Rows",
    "/events": "Event",
    "/events/recurring": "Recurring",
    **dict.fromkeys(journal.MESSAGES, "MessageColumns"),
    "/contacts": "Contact",
    TIMING: "Timing",
}
"""What message each topic has, but for parts of awareness; groups, entities and sensors are left out of it."""

Sensed = TypeVar("Sensed", bound=LoggedReading)
"""An entry of what a sensor measured."""


class Log(McapFile):
    """A log, opened by `open_log`.

    Attributes:
        foreign: Whether somebody else's software wrote it: it has no manifest, and its messages are not ours.
        manifest: Who took part; empty if the log is foreign, or broke off before it, or it is damaged.
    """

    def __init__(self, path: str | os.PathLike[str]):
        super().__init__(path)
        #: Whether there is a manifest that cannot be believed.
        self._bad_manifest = False
        self.manifest = self._read_manifest()
        self.foreign = not self.manifest and self.header.profile != PROFILE
        if self.manifest:
            self._limit()

    @cached_property
    def agents(self) -> Mapping[str, tuple[str, ...]]:
        """The ids of the agents in each group, in the order of rows."""
        return {name: tuple(group.get("agents", ())) for name, group in self.manifest.get("groups", {}).items()}

    @cached_property
    def presence(self) -> Mapping[str, tuple[tuple[int, int | None], ...]]:
        """From when until when each agent was in the world, ns, None for until the end; by id.

        Whoever never entered has no such span; most are there all the time.
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

    @cached_property
    def outcome(self) -> dict[str, Any] | None:
        """How the run ended; None if it did not come to its end, or the log broke off."""
        from symaware_cli.recording.manifest_schema import Outcome

        return self.json_metadata(OUTCOME, Outcome.model_validate)

    @cached_property
    def recovery(self) -> dict[str, Any] | None:
        """What was lost before this log was recovered from a damaged one; None if it was not."""
        from symaware_cli.recording.manifest_schema import Recovered

        return self.json_metadata(RECOVERY, Recovered.model_validate)

    def verify(self) -> Damage | None:
        """Read everything once, and return what is wrong with the file."""
        _ = self.outcome, self.recovery
        return super().verify()

    @cached_property
    def topics(self) -> Mapping[str, ChannelInfo]:
        """The channels by topic, and what shared ones say of single entities, as if these had channels of their own."""
        single = {topic: info for known in self._shared.values() for topic, info in known.channels.items()}
        return dict(sorted((single | self.channels).items()))

    @cached_property
    def _shared(self) -> Mapping[str, SharedChannel]:
        return {topic: known for topic, info in self.channels.items() if (known := shared(info))}

    def messages(
        self, topics: str | Iterable[str] | None = None, start: int | None = None, end: int | None = None
    ) -> Iterator[LogMessage]:
        """Iterate over messages, in the order of time and then sequence.

        Args:
            topics: Which, of `topics`; None for those of all `channels`.
            start: The first simulated time, ns.
            end: The first simulated time not wanted any more, ns.

        Raises:
            LogError: The file cannot be read any more, or a message does not fit its channel.
        """
        wanted = None if topics is None else {topics} if isinstance(topics, str) else set(topics)
        # Who had a channel of its own, in logs of other writers, is not looked for in a shared one.
        single = () if wanted is None else wanted - self.channels.keys()
        asked = {topic for topic, known in self._shared.items() if not known.channels.keys().isdisjoint(single)}
        if wanted is None or not asked:
            return super().messages(wanted, start, end)
        return self._split(super().messages(wanted | asked, start, end), wanted, single)

    def _split(
        self, messages: Iterable[LogMessage], wanted: Collection[str], single: Collection[str]
    ) -> Iterator[LogMessage]:
        for message in messages:
            known = self._shared.get(message.channel.topic)
            if known is None or message.channel.topic in wanted:
                yield message
            if known is not None:
                yield from known.split(message, single)

    def series(self, name: str, field: str) -> Series:
        """Put a series together.

        Args:
            name: A group, an agent, or an entity of the environment. The name of a group of one is its agent's.
            field: `state` (what they believe), `world` (what is true), `pose` and `joints` (the rest of that, in worlds
                of space); `control` (what the world applied in the step that ended then), `control_requested` (what
                was asked for from then on); a part of awareness, such as `intent`, `uncertainty` and `risk`, of which
                the first point is taken where it is a time series; or a sensor that measures numbers, by its
                component's name: its readings when they became known, NaN where it missed one.

        Returns:
            For a group every instant at which any of its agents was recorded, (k, n, columns), where the others keep
            their value (NaN before the first, and while they are not in the world); for an agent or an entity the
            instants at which it was recorded, (k, columns), with NaN at the one at which it left the world. Of entities
            only those that move were recorded.

        Raises:
            LogError: There is no such name or field.
        """
        group, row, count = self._place(name)
        topic, known = self.series_topic(group, field), self._fields(group)
        there = sorted(other for other in known if known[other] in self.topics)
        what = f"{field} of {name!r}"
        info = self._channel(topic, what, "Rows", "SeriesRows", instead=there)
        entries = ((message.time, *present_values(message.decode(), count)) for message in self.messages(info.topic))
        with self._fitting(info.topic):
            times, values = group_series(entries, count) if row is None else row_series(entries, row)
        columns, units = (_split(info.metadata.get(key, "")) for key in ("columns", "units"))
        if not len(times):
            values = np.empty((*values.shape[:-1], len(columns)))
        elif group in self.agents and "absent" in self.manifest["groups"][group]:
            spans = [self.presence[id] for id in self.agents[group]]
            times, values = gaps(times, values, spans) if row is None else cut(times, values, spans[row])
        return Series(times, values, columns, units)

    def series_topic(self, owner: str, field: str) -> str:
        """Return the topic of a field of `series`, of a group or an entity; nothing may have been recorded on it.

        Raises:
            UnknownNameError: There is no such field, and no sensor of that name that measures numbers.
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
        further = {name: f"/agents/{owner}/{name}" for name in self.parts(owner)}
        return sensors(self.channels, owner, MEASUREMENT) | further | fields

    def parts(self, group: str) -> dict[str, Part]:
        """The parts of awareness of a group that there are channels of, by name: first those of every group."""
        return parts_of(self.channels, group)

    def predictions(self, agent: str, field: str) -> Iterator[Prediction]:
        """Iterate over what an agent expected: the whole of its time series at each instant at which it set one.

        Args:
            agent: Its id.
            field: A part of awareness that is a time series: `intent`, `uncertainty`, `risk`, or one of a plugin.
                `series` names the columns.

        Raises:
            LogError: There is no such agent or field.
        """
        group, row, _ = self._agent(agent)
        parts = {part.name: part for part in PARTS} | self.parts(group)
        predicted = [name for name, part in parts.items() if part.kind == "series"]
        if field not in predicted:
            message = f"there is no field {field!r} of predictions; there are {', '.join(predicted)}"
            raise UnknownNameError(message, field, predicted)
        topic = self._channel(f"/agents/{group}/{field}", f"{field} of {agent!r}", "SeriesRows").topic
        return self._predictions(topic, row)

    def _predictions(self, topic: str, row: int) -> Iterator[Prediction]:
        for message in self.messages(topic):
            content = message.decode()
            place = place_of(row, content.rows)
            if place is not None:
                times, values = content.at(place)
                # Copies, so that one row does not keep the whole message in memory.
                yield Prediction(message.time, times[: len(values)].copy(), values.copy())

    def beliefs(self, agent: str, other: str) -> Beliefs:
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

    def events(self, start: int | None = None, end: int | None = None) -> Iterator[LoggedEvent]:
        """Iterate over the events.

        Args:
            start: The first simulated time, ns.
            end: The first simulated time not wanted any more, ns.
        """
        return self._journal("/events", "Event", journal.event, start, end)

    def communications(self, start: int | None = None, end: int | None = None) -> Iterator[Communication]:
        """Iterate over the stages of messages between agents; see `events`."""
        roster = self.manifest.get("roster", [])
        for message in self.messages(journal.MESSAGES, start, end):
            if message.channel.carries("Message") or message.channel.carries("MessageColumns"):
                with self._readable(message):
                    entries = journal.communications(message.time, message.decode(), roster)
                yield from entries

    def contacts(self, start: int | None = None, end: int | None = None) -> Iterator[LoggedContact]:
        """Iterate over the beginnings and ends of contacts; see `events`."""
        return self._journal("/contacts", "Contact", journal.contact, start, end)

    def scans(self, name: str | None = None, start: int | None = None, end: int | None = None) -> Iterator[LoggedScan]:
        """Iterate over the scans of lidars, one for each agent and turn.

        Args:
            name: An agent, or a group; None for everybody.
            start: The first simulated time, ns.
            end: The first simulated time not wanted any more, ns.

        Raises:
            LogError: There is no such name.
        """
        return self._sensed(SCAN, "Scan", scans, name, start, end)

    def images(
        self, name: str | None = None, start: int | None = None, end: int | None = None
    ) -> Iterator[LoggedImage]:
        """Iterate over the images of cameras: colours, depths and segments; see `scans`."""
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
        group, row, _ = (None, None, 0) if name is None else self._place(name)
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
        """Iterate over what agents know: an entry at the beginning, and one whenever it changed.

        Args:
            name: An agent, or a group; None for everybody.

        Raises:
            LogError: There is no such name.
        """
        groups = {f"/agents/{group}/knowledge": agents for group, agents in self.agents.items()}
        wanted: str | None = None
        if name is not None:
            group, row, _ = self._place(name)
            topic = f"/agents/{group}/knowledge"
            wanted = None if row is None else name
            groups = {topic: groups.get(topic, ())}
        return self._knowledge(groups, wanted)

    def _knowledge(self, groups: Mapping[str, Sequence[str]], agent: str | None) -> Iterator[LoggedKnowledge]:
        for message in self.messages(groups):
            topic = message.channel.topic
            if not message.channel.carries("Knowledge"):
                continue
            with self._fitting(topic):
                entries = journal.knowledge(message.time, message.decode(), groups[topic])
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

    @contextmanager
    def _fitting(self, topic: str) -> Iterator[None]:
        try:
            yield
        except ValueError as error:
            raise LogError(f"the messages on {topic} in {self.path} do not fit together: {error}") from error

    def _channel(self, topic: str, what: str, *message_names: str, instead: Sequence[str] = ()) -> ChannelInfo:
        if topic not in self.topics:
            there = f"; there {'are' if len(instead) > 1 else 'is'} {', '.join(instead)}" if instead else ""
            raise LogError(f"{self.path} has no {what} (no channel {topic}){there}{self._perhaps_lost}")
        info = self.topics[topic]
        if not any(info.carries(name) for name in message_names):
            raise LogError(
                f"{self.path} has no {what}: the messages on {topic} ({info.schema or 'no schema'}) are not ours"
            )
        return info

    @property
    def _perhaps_lost(self) -> str:
        """Why something may be missing, as the end of a sentence."""
        return f"; {self.damage}" if self.damage and self.damage.lost else ""

    def _agent(self, name: str) -> tuple[str, int, int]:
        """The group of an agent, the row in it, and the size of it."""
        group, row, count = self._place(name)
        if row is None or group not in self.agents:
            what = "an entity" if group not in self.agents else f"a group of {count}: name one of its agents"
            raise LogError(f"{name!r} is {what}")
        return group, row, count

    def _place(self, name: str) -> tuple[str, int | None, int]:
        """The group, the row in it (None for the whole group) and the size of it that a name stands for."""
        entities = self.manifest.get("entities", {})
        for group, agents in self.agents.items():
            if name in agents:
                return group, agents.index(name), len(agents)
        if name in self.agents:
            return name, None, len(self.agents[name])
        if name in entities:
            return name, 0, 1
        if any(template.format(name) in self.topics for template in TOPICS.values()):
            return name, None, 0
        there = ", ".join([*self.agents, *entities]) or "none"
        known = [*self.agents, *(id for agents in self.agents.values() for id in agents), *entities]
        raise UnknownNameError(f"{self.path} knows no {name!r}; there are {there}{self._perhaps_lost}", name, known)

    def require_manifest(self, advice: str = "") -> None:
        """Insist on a manifest.

        Args:
            advice: What to do without one; added to the error.

        Raises:
            LogError: There is none, or it is damaged.
        """
        if self.manifest:
            return
        if self._bad_manifest:
            raise LogError(f"the manifest in {self.path} is damaged{advice}")
        why = "was not written by SymAware" if self.foreign else "broke off before it says who takes part"
        raise LogError(f"{self.path} {why}{advice}")

    def _read_manifest(self) -> dict[str, Any]:
        places = [place for place in self.index.attachments if place.name == MANIFEST]
        written = [record.data for record in self.attachment_records(MANIFEST)]
        try:
            manifest = read_manifest(written[-1]) if written else {}
        except ValueError:
            manifest = {}
        if not manifest:
            if places and self.header.profile == PROFILE:
                self._bad_manifest = True
                for place in places:
                    self._leave_out(self.index.attachments, place)
            return {}
        if manifest["format"] > FORMAT:
            raise LogError(
                f"{self.path} was written by a newer SymAware: its format is {manifest['format']}, this one reads up "
                f"to {FORMAT}"
            )
        return manifest

    def _limit(self) -> None:
        """Let messages be about nobody but those of the manifest."""
        rows = {name: len(agents) for name, agents in self.agents.items()}
        rows |= dict.fromkeys(self.manifest.get("entities", {}), 1)
        roster = len(self.manifest["roster"]) if "roster" in self.manifest else None
        self._set_channels(
            {
                number: replace(
                    self._believed(info),
                    rows=rows.get(_owner(info.topic)),
                    roster=roster,
                    width=self._width(info),
                    message=_expected(info),
                )
                for number, info in self._channels.items()
            }
        )

    def _believed(self, info: ChannelInfo) -> ChannelInfo:
        """A channel as it is, but for one that many share and that tells of others than the manifest: it has nobody."""
        if info.topic not in SHARED:
            return info
        try:
            names = entities_of(info)
        except ValueError:
            return info
        sound = len(set(names)) == len(names) and set(names) <= self.manifest.get("entities", {}).keys()
        return info if sound else replace(info, metadata={**info.metadata, "entities": "[]"})

    def _width(self, info: ChannelInfo) -> int | None:
        """How many numbers a row has on a channel: those of the model's state, if it is about that."""
        group = self.manifest.get("groups", {}).get(_owner(info.topic), {})
        state = group.get("model", {}).get("state")
        if state and info.topic.endswith("/state"):
            return len(state)
        return len(_split(info.metadata.get("columns", ""))) or None


def _expected(info: ChannelInfo) -> str | None:
    """What message a channel must have; None where that is not known."""
    if info.topic == journal.MESSAGES[0] and info.carries("Message"):
        return "Message"  # as earlier versions wrote them
    part = part_of(info)
    return PART_MESSAGES[part.kind] if part else _MESSAGES.get(_pattern(info.topic))


def open_log(path: str | os.PathLike[str]) -> Log:
    """Open a log.

    A log that was cut off or damaged is read as far as that is possible; `Log.damage` tells what is missing. The MCAP
    of other software opens, too, with `Log.foreign` set: its channels and messages can be listed.

    Args:
        path: The file.

    Returns:
        The log.

    Raises:
        LogError: There is nothing to read: no such file, no permission, not an MCAP, or of a newer format.
    """
    return Log(path)


def _pattern(topic: str) -> str:
    """The topic without the names in it: `/agents/robot/scan/ahead` becomes `/agents//scan/`."""
    parts = topic.split("/")
    return "/".join(["" if place in (2, 4) else part for place, part in enumerate(parts)]) if _owner(topic) else topic


def _owner(topic: str) -> str:
    """The group or entity that a topic is about; empty if it is about none."""
    _, root, name, *rest = f"{topic}///".split("/")
    return name if root in ("agents", "world") and rest[0] else ""


def _split(names: str) -> tuple[str, ...]:
    return tuple(names.split(",")) if names else ()
