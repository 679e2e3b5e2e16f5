"""Whom an event concerns that triggers turns."""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Mapping

from symaware_cli.core import Contact, Event
from symaware_cli.runtime.timing import Trigger


def concerned(event: Event, trigger: Trigger, group: str, rows: Mapping[str, int]) -> Collection[int]:
    """The agents of a group that an event concerns, as rows.

    Args:
        event: What happened.
        trigger: What they wait for.
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
        return _meant(path, trigger, group, rows)
    if trigger.component not in (None, component):
        return []
    if owner in rows:
        return [rows[owner]]
    return rows.values() if owner == group else []


def _meant(path: str, trigger: Trigger, group: str, rows: Mapping[str, int]) -> Collection[int]:
    """The agents of a group that a fault happens to: it names agents or components of theirs by patterns."""
    owner, _, component = path.rpartition(".")
    if trigger.component is None:
        return _named(path, group, rows) or _named(owner, group, rows)
    return _named(owner, group, rows) if fnmatch.fnmatchcase(trigger.component, component) else []


def _named(pattern: str, group: str, rows: Mapping[str, int]) -> Collection[int]:
    """The agents of a group that a pattern means: all of them by the group's name, else by their ids."""
    if fnmatch.fnmatchcase(group, pattern):
        return rows.values()
    return [row for id, row in rows.items() if fnmatch.fnmatchcase(id, pattern)]
