"""Statuses of specifications where they are monitored."""

from __future__ import annotations

import numpy as np

from symaware_cli.core import AgentGroup, Clock
from symaware_cli.core.verdict import SpecificationStatus
from symaware_cli.specification.specification import Specification
from symaware_cli.specification.specification_monitor import SpecificationMonitor


class MonitorStatuses:
    """The statuses of one specification, read by agents; see `SpecificationStatuses`.

    Attributes:
        monitor: Its monitor.
    """

    def __init__(self, monitor: SpecificationMonitor, clock: Clock) -> None:
        self.monitor = monitor
        self._clock = clock
        self._rows: dict[str, list[int]] = {}
        scope = monitor.specification.scope
        for row in range(scope.rows):
            for id in scope.subjects(row):
                self._rows.setdefault(id, []).append(row)
        self._is_world = not self._rows

    def of(self, agent: str) -> SpecificationStatus | None:
        """The status for an agent; the worst, where it has several pairs."""
        rows = [0] if self._is_world else self._rows.get(agent)
        if rows is None or (self.monitor.specification.offer is not None and not self.monitor.begun[rows].any()):
            return None
        return self.monitor.status(rows)

    def measured(self, agent: str) -> float:
        """The robustness on the samples of an agent up to now; see `SpecificationMonitor.measured`."""
        return min(self.monitor.measured(row, self._clock.now) for row in self._rows.get(agent, [0]))

    @property
    def specification(self) -> Specification:
        """The specification itself."""
        return self.monitor.specification

    @property
    def began(self) -> int | None:
        """When its evaluation began, in nanoseconds; None before."""
        return min((cohort.start for cohort in self.monitor.cohorts), default=None)

    @property
    def worst(self) -> SpecificationStatus:
        """The worst of all that were ever there."""
        begun = np.flatnonzero(self.monitor.begun).tolist()
        return self.monitor.status(begun or range(len(self.monitor.begun)))


def monitor_of(group: AgentGroup, name: str) -> SpecificationMonitor:
    """Return the monitor of a specification of a group.

    Raises:
        ValueError: It is not monitored in this process.
    """
    statuses = group.specifications.get(name)
    if not isinstance(statuses, MonitorStatuses):
        raise ValueError(f"`{name}` is not monitored in this process")
    return statuses.monitor
