"""Log files: agents and entities, channels and messages of a log."""

from __future__ import annotations

import os
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from typing import Any

from symaware_cli.log import logged_events
from symaware_cli.log.error import LogError, UnknownNameError
from symaware_cli.log.fields import SIGNAL_MESSAGES, signal_of
from symaware_cli.log.index import ChannelInfo
from symaware_cli.log.log_message import LogMessage
from symaware_cli.log.log_schema import FORMAT, MANIFEST, OUTCOME, PROFILE, RECOVERY, TIMING
from symaware_cli.log.manifest import read_manifest
from symaware_cli.log.mcap_file import McapFile
from symaware_cli.log.names import INPUTS, TOPICS
from symaware_cli.log.recovery import Damage
from symaware_cli.log.sensor_channels import IMAGE, SCAN
from symaware_cli.log.shared_channel import SHARED, SharedChannel, entities_of, shared

_MESSAGES = {
    "/agents//control": "Rows",
    "/agents//awareness": "Awareness",
    "/agents//knowledge": "Knowledge",
    f"/agents//{SCAN}/": "Scan",
    f"/agents//{IMAGE}/": "Image",
    "/world//state": "Rows",
    "/world//pose": "Rows",
    "/world//joints": "Rows",
    **dict.fromkeys(SHARED, "Rows"),
    "/world//control": "Rows",
    "/events": "Event",
    "/events/recurring": "Recurring",
    **dict.fromkeys(logged_events.MESSAGES, "MessageColumns"),
    "/contacts": "Contact",
    INPUTS: "Event",
    TIMING: "Timing",
}
"""The message type of each topic, except for parts and signals; names of groups, entities and sensors are omitted."""


class LogFile(McapFile):
    """A log file.

    Attributes:
        foreign: Whether another program wrote it; it then has no manifest and no SymAware messages.
        manifest: The manifest; empty if the log is foreign, or if the manifest is missing or damaged.
    """

    def __init__(self, path: str | os.PathLike[str]):
        super().__init__(path)
        #: Whether the manifest is damaged.
        self._bad_manifest = False
        self.manifest = self._read_manifest()
        self.foreign = not self.manifest and self.header.profile != PROFILE
        if self.manifest:
            self._apply_manifest()

    @cached_property
    def agents(self) -> Mapping[str, tuple[str, ...]]:
        """The ids of the agents in each group, in row order."""
        return {name: tuple(group.get("agents", ())) for name, group in self.manifest.get("groups", {}).items()}

    @cached_property
    def outcome(self) -> dict[str, Any] | None:
        """How the run ended; None if it did not end, or the log was cut off."""
        from symaware_cli.log.manifest_schema import RunOutcome

        return self.json_metadata(OUTCOME, RunOutcome.model_validate)

    @cached_property
    def recovery(self) -> dict[str, Any] | None:
        """The loss of the damaged log that this one was recovered from; None if it was not recovered."""
        from symaware_cli.log.manifest_schema import Recovered

        return self.json_metadata(RECOVERY, Recovered.model_validate)

    def verify(self) -> Damage | None:
        """Read the whole file, and return its damage."""
        _ = self.outcome, self.recovery
        return super().verify()

    @cached_property
    def topics(self) -> Mapping[str, ChannelInfo]:
        """The channels by topic, where shared channels appear as separate channels of their entities."""
        single = {topic: info for known in self._shared.values() for topic, info in known.channels.items()}
        return dict(sorted((single | self.channels).items()))

    @cached_property
    def _shared(self) -> Mapping[str, SharedChannel]:
        return {topic: known for topic, info in self.channels.items() if (known := shared(info))}

    def messages(
        self, topics: str | Iterable[str] | None = None, start: int | None = None, end: int | None = None
    ) -> Generator[LogMessage, None, None]:
        """Iterate over messages, ordered by time and then sequence.

        Args:
            topics: Some of `topics`; None for those of all `channels`.
            start: The first simulated time, ns.
            end: The simulated time at which to stop, exclusive, ns.

        Raises:
            LogError: The file can no longer be read, or a message does not fit its channel.
        """
        wanted = None if topics is None else {topics} if isinstance(topics, str) else set(topics)
        # Entities with separate channels, in logs of other writers, are not searched for in shared ones.
        single = () if wanted is None else wanted - self.channels.keys()
        asked = {topic for topic, known in self._shared.items() if not known.channels.keys().isdisjoint(single)}
        if wanted is None or not asked:
            return super().messages(wanted, start, end)
        return self._split(super().messages(wanted | asked, start, end), wanted, single)

    def _split(
        self, messages: Iterable[LogMessage], wanted: Collection[str], single: Collection[str]
    ) -> Generator[LogMessage, None, None]:
        for message in messages:
            known = self._shared.get(message.channel.topic)
            if known is None or message.channel.topic in wanted:
                yield message
            if known is not None:
                yield from known.split(message, single)

    @contextmanager
    def _consistent(self, topic: str) -> Iterator[None]:
        try:
            yield
        except ValueError as error:
            raise LogError(f"the messages on {topic} in {self.path} do not fit together: {error}") from error

    def _channel(self, topic: str, what: str, *message_names: str, instead: Sequence[str] = ()) -> ChannelInfo:
        if topic not in self.topics:
            there = f"; there {'are' if len(instead) > 1 else 'is'} {', '.join(instead)}" if instead else ""
            raise LogError(f"{self.path} has no {what} (no channel {topic}){there}{self._loss_note}")
        info = self.topics[topic]
        if not any(info.carries(name) for name in message_names):
            raise LogError(
                f"{self.path} has no {what}: the messages on {topic} ({info.schema or 'no schema'}) are not "
                "SymAware messages"
            )
        return info

    @property
    def _loss_note(self) -> str:
        """Why something may be missing, to be appended to a sentence."""
        return f"; {self.damage}" if self.damage and self.damage.lost else ""

    def _locate_agent(self, name: str) -> tuple[str, int, int]:
        """Return the group of an agent, its row, and the size of the group."""
        group, row, count = self._locate(name)
        if row is None or group not in self.agents:
            what = "an entity" if group not in self.agents else f"a group of {count}: name one of its agents"
            raise LogError(f"{name!r} is {what}")
        return group, row, count

    def _locate(self, name: str) -> tuple[str, int | None, int]:
        """Return the group, the row (None for a whole group) and the size of the group that a name refers to."""
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
        raise UnknownNameError(
            f"{self.path} has no agent, group or entity {name!r}; there are {there}{self._loss_note}", name, known
        )

    def require_manifest(self, advice: str = "") -> None:
        """Raise an error if there is no manifest.

        Args:
            advice: Advice for users without one; appended to the error message.

        Raises:
            LogError: The manifest is missing or damaged.
        """
        if self.manifest:
            return
        if self._bad_manifest:
            raise LogError(f"the manifest in {self.path} is damaged{advice}")
        why = "was not written by SymAware" if self.foreign else "was cut off before its manifest"
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

    def _apply_manifest(self) -> None:
        """Restrict the messages of each channel to the agents and entities of the manifest."""
        rows = {name: len(agents) for name, agents in self.agents.items()}
        rows |= dict.fromkeys(self.manifest.get("entities", {}), 1)
        roster = len(self.manifest["roster"]) if "roster" in self.manifest else None
        self._set_channels(
            {
                number: replace(
                    self._without_unknown_entities(info),
                    rows=rows.get(_owner(info.topic)),
                    roster=roster,
                    width=self._width(info),
                    message=_expected(info),
                )
                for number, info in self._channels.items()
            }
        )

    def _without_unknown_entities(self, info: ChannelInfo) -> ChannelInfo:
        """Return a channel unchanged, except that a shared one with entities unknown to the manifest loses them."""
        if info.topic not in SHARED:
            return info
        try:
            names = entities_of(info)
        except ValueError:
            return info
        sound = len(set(names)) == len(names) and set(names) <= self.manifest.get("entities", {}).keys()
        return info if sound else replace(info, metadata={**info.metadata, "entities": "[]"})

    def _width(self, info: ChannelInfo) -> int | None:
        """Return the number of columns of a channel; for states, that of the model."""
        group = self.manifest.get("groups", {}).get(_owner(info.topic), {})
        state = group.get("model", {}).get("state")
        if state and info.topic.endswith("/state"):
            return len(state)
        return len(names_in(info.metadata.get("columns", ""))) or None


def _expected(info: ChannelInfo) -> str | None:
    """Return the message type that a channel must have; None if unknown."""
    if info.topic == logged_events.MESSAGES[0] and info.carries("Message"):
        return "Message"  # as earlier versions wrote them
    if known := _MESSAGES.get(_pattern(info.topic)):
        return known
    signal = signal_of(info)
    return SIGNAL_MESSAGES[signal[1].kind] if signal else None


def _pattern(topic: str) -> str:
    """Return a topic without its names: `/agents/robot/scan/ahead` becomes `/agents//scan/`."""
    parts = topic.split("/")
    return "/".join(["" if place in (2, 4) else part for place, part in enumerate(parts)]) if _owner(topic) else topic


def _owner(topic: str) -> str:
    """Return the group or entity that a topic belongs to; empty if none."""
    _, root, name, *rest = f"{topic}///".split("/")
    return name if root in ("agents", "world") and rest[0] else ""


def names_in(names: str) -> tuple[str, ...]:
    """Parse a list of names in metadata."""
    return tuple(names.split(",")) if names else ()
