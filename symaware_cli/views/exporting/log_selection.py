"""Selects the part of a log to export: fields, agents and an interval of time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from symaware_cli.log import TABLES, Log, UnknownNameError


@dataclass(frozen=True, slots=True)
class Selection:
    """The part of a log to export.

    Attributes:
        fields: Some of `TABLES`, or names of parts of awareness and signals; None for all.
        agents: Ids of agents and names of entities; None for all.
        start: The first simulated time [ns]; None for the beginning.
        end: The simulated time at which to stop, exclusive [ns]; None for the end.
    """

    fields: frozenset[str] | None = None
    agents: frozenset[str] | None = None
    start: int | None = None
    end: int | None = None

    def has_field(self, field: str) -> bool:
        """Whether a field is selected."""
        return self.fields is None or field in self.fields

    def has_agent(self, *names: str) -> bool:
        """Whether one of these agents or entities is selected."""
        return self.agents is None or not self.agents.isdisjoint(names)

    def has_source(self, source: str) -> bool:
        """Whether the source of an event, such as ``agents.robot.2.steer``, belongs to a selected agent."""
        if self.agents is None:
            return True
        parts = source.split(".")
        return parts[0] == "agents" and self.has_agent(parts[1] if len(parts) > 1 else "", ".".join(parts[1:3]))


def select(
    log: Log,
    *,
    fields: Iterable[str] | None = None,
    agents: Iterable[str] | None = None,
    start: int | None = None,
    end: int | None = None,
) -> Selection:
    """Select the part of a log to export.

    Args:
        log: The log.
        fields: Some of `TABLES`, or names of parts of awareness and signals; None for all.
        agents: Agents, groups and entities; None for all.
        start: The first simulated time [ns].
        end: The simulated time at which to stop, exclusive [ns].

    Raises:
        UnknownNameError: A field or a name does not exist.
    """
    wanted = None if fields is None else frozenset(fields)
    signals = (each.name for group in log.agents for each in log.signals(group).values())
    known = list(dict.fromkeys([*TABLES, *signals]))
    for field in sorted(wanted or ()):
        if field not in known:
            raise UnknownNameError(f"there is no field `{field}`, only {', '.join(known)}", field, known)
    return Selection(wanted, None if agents is None else _agents(log, agents), start, end)


def _agents(log: Log, names: Iterable[str]) -> frozenset[str]:
    groups: dict[str, Any] = log.manifest.get("groups", {})
    members = {name: frozenset(group.get("agents", ())) for name, group in groups.items()}
    members |= {agent: frozenset([agent]) for agents in list(members.values()) for agent in agents}
    members |= {entity: frozenset([entity]) for entity in log.manifest.get("entities", {})}
    chosen: set[str] = set()
    for name in names:
        if name not in members:
            raise UnknownNameError(f"{log.path} has no agent, group or entity `{name}`", name, sorted(members))
        chosen |= members[name]
    return frozenset(chosen)
