"""Matches events with triggers: finds the agents whose turns an event triggers."""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Mapping

from symaware_cli.core import Contact, Event
from symaware_cli.runtime.timing import Trigger


def concerned(event: Event, trigger: Trigger, group: str, rows: Mapping[str, int]) -> Collection[int]:
    """The rows of the agents of a group that an event concerns.

    Args:
        event: The event.
        trigger: The trigger of the agents' components.
        group: The group's name.
        rows: The row of each of its agents, by id.
    """
    if trigger.source is not None:
        contact = event.subject
        if isinstance(contact, Contact):
            return [rows[id] for id in (contact.first, contact.second) if id in rows]
        return rows.values()
    path = event.source.removeprefix("agents.")
    owner, _, component = path.rpartition(".")
    if path in rows and trigger.component is None:
        return [rows[path]]
    if event.name in ("fault", "fault-over"):
        return _fault_targets(path, trigger, group, rows)
    if trigger.component not in (None, component):
        return []
    if owner in rows:
        return [rows[owner]]
    return rows.values() if owner == group else []


def _fault_targets(path: str, trigger: Trigger, group: str, rows: Mapping[str, int]) -> Collection[int]:
    """The agents of a group that a fault affects: it names agents or their components by patterns."""
    owner, _, component = path.rpartition(".")
    if trigger.component is None:
        return _matching(path, group, rows) or _matching(owner, group, rows)
    return _matching(owner, group, rows) if fnmatch.fnmatchcase(trigger.component, component) else []


def _matching(pattern: str, group: str, rows: Mapping[str, int]) -> Collection[int]:
    """The agents of a group that match a pattern: all if the group's name matches, otherwise by their ids."""
    if fnmatch.fnmatchcase(group, pattern):
        return rows.values()
    return [row for id, row in rows.items() if fnmatch.fnmatchcase(id, pattern)]
