"""What sensors have in common: what they measure becomes known later, and they miss some of it."""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from typing import Any, ClassVar

from pydantic import BaseModel, Field

from symaware_cli.core import AgentGroup, GroupComponent, Parameters, nanoseconds


class SensorParameters(Parameters):
    """What every sensor can be told."""

    delay: float = Field(
        0.0, ge=0, le=1e9, description="How long after it was measured a reading becomes known, at the next turn [s]."
    )
    dropout: float = Field(0.0, ge=0, le=1, description="Probability that what could be measured is missed.")


class Sensor(GroupComponent):
    """Measures at each of its turns; what it measured becomes known with its delay.

    How often it measures is the component's `period` in the scenario. A sensor that declares a signal hands out that,
    for the log and for whoever looks at it (`awareness["radar.returns"]`); scans and images are put among the
    `readings` of the group's awareness, by the sensor's name.
    """

    sees_world = True

    Parameters: ClassVar[type[BaseModel]] = SensorParameters

    def initialise_component(self, group: AgentGroup) -> None:
        """Take up work."""
        super().initialise_component(group)
        self._number = self.environment.roster.groups.index(group.name)
        self._start = self.environment.roster.start(group.name)
        self._delay = nanoseconds(self.parameters.delay)
        self._late: deque[tuple[int, Any]] = deque()
        #: What was true at the turn before, as `present` returned it; None before the first.
        self._before: Any = None

    @abstractmethod
    def measure(self, present: Any) -> Any:
        """Measure the world as it is now.

        Args:
            present: What `present` returned.

        Returns:
            What the sensor's signal says of each agent, as `record` takes it; with several signals a dictionary of
            that by their names; or a reading.
        """

    def present(self) -> Any:
        """What is true now that the next measurement will be compared with, for sensors that compare."""
        return None

    def _compute(self) -> tuple[Any, Any]:
        present = self.present()
        return self.measure(present), present

    def _update(self, value: tuple[Any, Any]) -> None:
        found, self._before = value
        late, known = self._late, None
        late.append((self.computed_at, found))
        while late and late[0][0] + self._delay <= self.computed_at:
            known = late.popleft()
        if known is not None:
            self._make_known(known[1])

    def _make_known(self, found: Any) -> None:
        if not self.signals:
            self._group.awareness.readings[self.name] = found
            return
        several = found if len(self.signals) > 1 else {self.signals[0].name: found}
        for signal in self.signals:
            self.record(signal, several[signal.name])
