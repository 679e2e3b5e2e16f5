"""Base class of sensors: periodic measurements with a delay and dropouts."""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from typing import Any, ClassVar

import numpy as np
from pydantic import BaseModel, Field

from symaware_cli.core import AgentGroup, GroupComponent, Parameters, nanoseconds
from symaware_cli.geometry import Array


class SensorParameters(Parameters):
    """Parameters of all sensors."""

    delay: float = Field(
        0.0, ge=0, le=1e9, description="How long after it was measured a reading becomes known, at the next turn [s]."
    )
    dropout: float = Field(0.0, ge=0, le=1, description="Probability that what could be measured is missed.")


class Sensor(GroupComponent):
    """Measures at each of its turns, and publishes each measurement after its delay.

    The component's `period` in the scenario is the sampling period. A sensor that declares signals records them, for
    the log and for other components (`awareness["radar.returns"]`); scans and images are stored among the `readings` of
    the group's awareness, by the sensor's name.
    """

    sees_world = True

    Parameters: ClassVar[type[BaseModel]] = SensorParameters

    def initialise_component(self, group: AgentGroup) -> None:
        """Start without measurements."""
        super().initialise_component(group)
        self._number = self.environment.roster.number(group.name)
        self._start = self.environment.roster.start(group.name)
        self._delay = nanoseconds(self.parameters.delay)
        self._pending: deque[tuple[int, Any]] = deque()
        #: What `present` returned at the previous turn; None before the first.
        self._before: Any = None

    @abstractmethod
    def measure(self, present: Any) -> Any:
        """Measure the world as it is now.

        Args:
            present: What `present` returned.

        Returns:
            The values of the sensor's signal, as accepted by `record`; with several signals a dictionary of values by
            their names; without signals a reading.
        """

    def _headings(self) -> Array:
        """Return the true headings of the agents [rad], 0 if they have none; shape (n,)."""
        heading, state = self._group.model.heading, self.environment.snapshot().states[self._number]
        return np.zeros(len(state)) if heading is None else state[:, heading]

    def with_dropouts(self, values: Array) -> Array:
        """Return measurements (n, k) as a read-only array, with NaN in the rows of missed measurements."""
        if self.parameters.dropout:
            values[self.random.uniform(1, "dropout")[:, 0] < self.parameters.dropout] = np.nan
        values.flags.writeable = False
        return values

    def present(self) -> Any:
        """Return true values that the next measurement is compared with, for sensors that need them."""
        return None

    def _compute(self) -> tuple[Any, Any]:
        present = self.present()
        return self.measure(present), present

    def _update(self, value: tuple[Any, Any]) -> None:
        found, self._before = value
        pending, known = self._pending, None
        pending.append((self.computed_at, found))
        while pending and pending[0][0] + self._delay <= self.computed_at:
            known = pending.popleft()
        if known is not None:
            self._publish(known[1])

    def _publish(self, found: Any) -> None:
        if not self.signals:
            self._group.awareness.readings[self.name] = found
            return
        several = found if len(self.signals) > 1 else {self.signals[0].name: found}
        for signal in self.signals:
            self.record(signal, several[signal.name])
