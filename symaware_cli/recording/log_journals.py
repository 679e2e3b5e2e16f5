"""Reads the entries of a log: events, messages, contacts, knowledge, scans and images."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any, TypeVar

from symaware_cli.recording import logged_events
from symaware_cli.recording.error import LogError
from symaware_cli.recording.log_file import LogFile
from symaware_cli.recording.log_message import LogMessage
from symaware_cli.recording.logged_events import Communication, LoggedContact, LoggedEvent, LoggedKnowledge
from symaware_cli.recording.sensor_channels import (
    IMAGE,
    SCAN,
    LoggedImage,
    LoggedReading,
    LoggedScan,
    images,
    scans,
    sensors,
)
from symaware_cli.recording.specifications import LoggedSpecification, logged, outcome_in, specification_channels
from symaware_cli.specification.outcome import Outcome

Sensed = TypeVar("Sensed", bound=LoggedReading)
"""An entry with the reading of a sensor."""


class LogJournals(LogFile):
    """A log with iterators over its entries."""

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
        """The outcomes of the specifications that were monitored, in the scenario's order."""
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
