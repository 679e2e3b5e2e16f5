"""The specifications that an agent still has to satisfy: their instances that are not decided yet."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from symaware_cli.core import Agent
from symaware_cli.geometry import Array
from symaware_cli.specification import Monitor, Specification, SpecificationMonitor, monitor_of
from symaware_cli.specification.formula import horizon


class Instance(NamedTuple):
    """A specification from one of the instants on that it is about.

    Attributes:
        specification: The specification.
        start: That instant, in nanoseconds.
        first: The same, in steps from the present on; negative in the past.
        last: The last instant that counts, in steps from the present on: that of the specification, or of the run.
        other: The other agent that it is about, if it is about pairs; empty otherwise.
        past: The robustness of each predicate from there until before the present, each of shape (-first,).
    """

    specification: Specification
    start: int
    first: int
    last: int
    other: str
    past: Sequence[Array]


def open_instances(agent: Agent, names: Sequence[str], present: int, step: int) -> list[Instance]:
    """Return the instances of specifications of an agent that are undecided, and about more than the present.

    Args:
        agent: The agent.
        names: The names of the specifications.
        present: The present instant, in nanoseconds.
        step: The time between two instants, in nanoseconds.

    Raises:
        ValueError: A specification is not monitored in this process.
    """
    end_of_run = agent.surroundings.clock.end
    if end_of_run is None:
        raise ValueError("a plan needs to know when the run ends")
    found = []
    for name in names:
        monitor = monitor_of(agent.group, name)
        specification = monitor.specification
        rows = [(agent.row, "")] if specification.each is not None else _partners(specification, agent.id)
        every = [(start, past, other) for row, other in rows for start, past in _of_row(monitor, row, present)]
        for start, past, other in every:
            first = -((present - start) // step)
            bounded = horizon(specification.formulation.formula)
            last = (end_of_run - present) // step if bounded is None else first + bounded
            if specification.end is not None:
                last = min(last, (specification.end - present) // step)
            if last > 0:
                found.append(Instance(specification, start, first, last, other, past))
    return found


def _partners(specification: Specification, agent: str) -> list[tuple[int, str]]:
    """Return the rows of the pairs that an agent is part of, each with the other agent."""
    scope = specification.scope
    pairs = [(row, scope.agents(row)) for row in range(scope.rows)]
    return [(row, next(id for id in ids if id != agent)) for row, ids in pairs if agent in ids]


def _of_row(monitor: SpecificationMonitor, row: int, present: int) -> Iterator[tuple[int, Sequence[Array]]]:
    """Yield where the instances of a row begin, with the robustness of predicates since then."""
    for cohort in monitor.cohorts:
        for place in np.flatnonzero(cohort.rows == row).tolist():
            if isinstance(cohort.monitor, Monitor) and cohort.monitor.verdict[place] == 0:
                history = cohort.monitor.history
                if history is None:
                    raise ValueError(f"the past of `{monitor.specification.name}` is too long to be kept for a plan")
                yield cohort.start, [values[:, place] for values in history]
    if monitor.awaited[row] and not monitor.is_over:
        yield max(monitor.specification.start, present), ()
