"""Checks that no agents wait for each other: liveness that each assumes of the others proves nothing of any of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from symaware_cli.runtime.simulation import ComponentEntry
from symaware_cli.scenario.diagnosis import Diagnosis
from symaware_cli.scenario.problem import quoted
from symaware_cli.scenario.source import Path


def check_circular_assumptions(entries: Sequence[ComponentEntry], diagnosis: Diagnosis) -> None:
    """Report each assumption that something happens again and again which closes a circle of such assumptions.

    From safety that agents assume of each other the safety of all follows, step by step (Abadi and Lamport, Conjoining
    specifications, ACM TOPLAS 17(3), 1995). For liveness that is not so: each may wait for ever for the other.

    Args:
        entries: All component entries.
        diagnosis: Takes problems.
    """
    waits: dict[str, dict[Path, set[str]]] = {}
    group_of = {agent: entry.group.name for entry in entries for agent in entry.group.ids}
    for entry in entries:
        # Components with strategies have `awaited`; to import their class would slow down every run.
        awaited: Mapping[int, set[str]] = getattr(entry.components[0], "awaited", {})
        for number, others in awaited.items():
            groups = {group_of[each] for each in others if each in group_of}
            waits.setdefault(entry.group.name, {})[(*entry.section, "with", "assumptions", number)] = groups
    after = {group: set[str]().union(*places.values()) for group, places in waits.items()}
    for group, places in waits.items():
        for path, others in places.items():
            circle = next((each for each in sorted(others) if group in _reachable(each, after)), None)
            if circle is None:
                continue
            diagnosis.report(
                "circular-assumptions",
                f"{quoted(group)} waits for {quoted(circle)}, and that waits for {quoted(group)}: "
                "they might wait for each other for ever",
                path,
                expected="safety; let one of them guarantee its part without waiting for the other",
            )


def _reachable(start: str, after: Mapping[str, set[str]]) -> set[str]:
    """Return the groups that a group waits for, directly or not, and itself."""
    found, waiting = {start}, [start]
    while waiting:
        fresh = after.get(waiting.pop(), set()) - found
        found |= fresh
        waiting += fresh
    return found
