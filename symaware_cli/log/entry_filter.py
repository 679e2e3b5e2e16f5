"""Selects entries of a log: events, messages between agents, and contacts."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from fnmatch import fnmatchcase

from symaware_cli.log.error import UnknownNameError
from symaware_cli.log.logged_events import Communication, LoggedContact, LoggedEvent
from symaware_cli.log.reader import Log
from symaware_cli.world import record

LEVELS = ("DEBUG", "INFO", "WARNING", "ERROR")
"""The levels of events, in ascending order of severity."""


@record
class EntryFilter:
    """Criteria for entries; those left out do not restrict. In patterns, ``*`` matches any text.

    Attributes:
        agents: Patterns of the agents, groups and entities that entries concern.
        name: Pattern of the names of events.
        source: Pattern of the sources of events.
        level: Minimum level of events, one of `LEVELS`.
        kind: Pattern of the kinds of messages.
        stage: The stage of messages (`SENT`, ...) or of contacts (`BEGIN`, ...).
        start: The first simulated time, ns.
        end: The last simulated time, ns.
    """

    agents: tuple[str, ...] = ()
    name: str | None = None
    source: str | None = None
    level: str | None = None
    kind: str | None = None
    stage: str | None = None
    start: int | None = None
    end: int | None = None

    def events(self, log: Log) -> Iterator[LoggedEvent]:
        """Iterate over the matching events.

        An event concerns an agent if the agent is its source or is named in its data.

        Raises:
            UnknownNameError: No agent, group or entity matches a pattern.
        """
        concerned = self._concerned(log)
        within = tuple(f"agents.{name}." for name in concerned or ())
        grave = LEVELS[LEVELS.index(self.level) :] if self.level else LEVELS
        for event in log.events(self.start, self._stop):
            if (
                (concerned is None or f"{event.source}.".startswith(within) or _named(event, concerned))
                and _matches(event.name, self.name)
                and _matches(event.source, self.source)
                # Later versions may add levels.
                and (event.level in grave or event.level not in LEVELS)
            ):
                yield event

    def communications(self, log: Log) -> Iterator[Communication]:
        """Iterate over the matching stages of messages whose sender or receiver is one of the agents.

        Raises:
            UnknownNameError: No agent, group or entity matches a pattern.
        """
        concerned = self._concerned(log)
        for entry in log.communications(self.start, self._stop):
            if (
                (concerned is None or entry.sender in concerned or entry.receiver in concerned)
                and _matches(entry.kind, self.kind)
                and self.stage in (None, entry.stage)
            ):
                yield entry

    def contacts(self, log: Log) -> Iterator[LoggedContact]:
        """Iterate over the matching beginnings and ends of contacts.

        Raises:
            UnknownNameError: No agent, group or entity matches a pattern.
        """
        concerned = self._concerned(log)
        for entry in log.contacts(self.start, self._stop):
            if (concerned is None or entry.a in concerned or entry.b in concerned) and self.stage in (
                None,
                entry.stage,
            ):
                yield entry

    @property
    def _stop(self) -> int | None:
        return None if self.end is None else self.end + 1

    def _concerned(self, log: Log) -> Collection[str] | None:
        """Return the names that match the patterns, including the agents of matching groups; None for all."""
        if not self.agents:
            return None
        members: dict[str, tuple[str, ...]] = {id: (id,) for agents in log.agents.values() for id in agents}
        members |= {group: (group, *agents) for group, agents in log.agents.items()}
        members |= {entity: (entity,) for entity in log.manifest.get("entities", {})}
        concerned: dict[str, None] = {}
        for pattern in self.agents:
            found = [name for name in members if fnmatchcase(name, pattern)]
            if not found:
                raise UnknownNameError(f"{log.path} has no agent, group or entity {pattern!r}", pattern, members)
            concerned |= dict.fromkeys(name for each in found for name in members[each])
        return concerned.keys()


def _named(event: LoggedEvent, names: Collection[str]) -> bool:
    return any(isinstance(value, str) and value in names for value in event.data.values())


def _matches(text: str, pattern: str | None) -> bool:
    return pattern is None or fnmatchcase(text, pattern)
