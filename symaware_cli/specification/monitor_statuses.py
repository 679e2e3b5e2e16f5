"""Statuses of specifications where they are monitored."""

from __future__ import annotations

import numpy as np

from symaware_cli.core.verdict import SpecificationStatus
from symaware_cli.specification.specification import Specification, SpecificationMonitor


class MonitorStatuses:
    """The statuses of one specification, read by agents; see `SpecificationStatuses`.

    Attributes:
        monitor: Its monitor.
    """

    def __init__(self, monitor: SpecificationMonitor) -> None:
        self.monitor = monitor
        self._rows: dict[str, list[int]] = {}
        scope = monitor.specification.scope
        for row in range(scope.rows):
            for id in scope.agents(row):
                self._rows.setdefault(id, []).append(row)
        self._is_world = not self._rows

    def of(self, agent: str) -> SpecificationStatus | None:
        """The status for an agent; the worst, where it has several pairs."""
        rows = [0] if self._is_world else self._rows.get(agent)
        return None if rows is None else self.monitor.status(rows)

    @property
    def specification(self) -> Specification:
        """The specification itself."""
        return self.monitor.specification

    @property
    def worst(self) -> SpecificationStatus:
        """The worst of all that were ever there."""
        begun = np.flatnonzero(self.monitor.begun).tolist()
        return self.monitor.status(begun or range(len(self.monitor.begun)))
