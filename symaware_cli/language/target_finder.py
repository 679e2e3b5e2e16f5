"""Finds the agents and components that faults affect, by ids, groups or patterns."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Sequence
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup
from symaware_cli.engine import AgentSelection, ComponentEntry, ComponentSelection
from symaware_cli.language.diagnosis import Diagnosis, ReportedError
from symaware_cli.language.source import Path


class TargetFinder:
    """Finds agents and components; a problem is reported, and a `ReportedError` raised."""

    def __init__(self, diagnosis: Diagnosis, groups: Sequence[AgentGroup], entries: Sequence[ComponentEntry]) -> None:
        self._diagnosis = diagnosis
        self._groups = groups
        self._entries = entries

    def agents(self, pattern: str, path: Path) -> list[AgentSelection]:
        """The agents that match a pattern."""
        found = [AgentSelection(group, rows) for group in self._groups if (rows := _rows(group, pattern))]
        if not found:
            known = [*(group.name for group in self._groups), *(id for group in self._groups for id in group.ids)]
            self._refuse_unknown("agent or group", pattern, path, known)
        return found

    def components(self, pattern: str, path: Path) -> list[ComponentSelection]:
        """The components that match a pattern."""
        agents, _, name = pattern.rpartition(".")
        found = [
            ComponentSelection(entry, rows)
            for entry in self._entries
            if fnmatch.fnmatchcase(entry.name, name)
            and (rows := [row for row in _rows(entry.group, agents) if entry.rows is None or row in entry.rows])
        ]
        if not found:
            owners = [(owner, entry.name) for entry in self._entries for owner in (entry.group.name, *entry.group.ids)]
            self._refuse_unknown("component", pattern, path, [f"{owner}.{each}" for owner, each in owners])
        return found

    def vector(self, values: Sequence[float], groups: Iterable[AgentGroup], path: Path) -> NDArray[np.float64]:
        """A vector with one number for each element of the state of all groups; shape (nx,)."""
        for group in groups:
            width = len(group.model.state)
            if len(values) != width:
                names = ", ".join(quantity.name for quantity in group.model.state)
                message = f"there are {len(values)} numbers for a state of {width}"
                self._diagnosis.refuse("wrong-length", message, path, expected=f"{width}: {names}")
        return np.array(values, float)

    def _refuse_unknown(self, noun: str, pattern: str, path: Path, known: Sequence[str]) -> NoReturn:
        """Report that nothing matches a pattern, with the names that exist."""
        self._diagnosis.report_unknown(noun, pattern, path, known)
        raise ReportedError


def _rows(group: AgentGroup, pattern: str) -> list[int]:
    """The rows of a group that match a pattern: all if the group's name matches, otherwise by the agents' ids."""
    if fnmatch.fnmatchcase(group.name, pattern):
        return list(range(len(group)))
    return [row for row, id in enumerate(group.ids) if fnmatch.fnmatchcase(id, pattern)]
