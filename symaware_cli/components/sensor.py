"""What sensors have in common: what they measure becomes known later, and they miss some of it."""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from typing import Any, ClassVar

from pydantic import BaseModel, Field

from symaware_cli.core import AgentGroup, GroupComponent, Parameters, Reading, nanoseconds


class SensorParameters(Parameters):
    """What every sensor can be told."""

    delay: float = Field(
        0.0, ge=0, le=1e9, description="How long after it was measured a reading becomes known, at the next turn [s]."
    )
    dropout: float = Field(0.0, ge=0, le=1, description="Probability that what could be measured is missed.")


class Sensor(GroupComponent):
    """Measures at each of its turns, and puts the reading among those of the group's awareness, by its own name.

    How often it measures is the component's `period` in the scenario.
    """

    sees_world = True

    Parameters: ClassVar[type[BaseModel]] = SensorParameters

    def initialise_component(self, group: AgentGroup) -> None:
        """Take up work."""
        super().initialise_component(group)
        self._number = self.environment.roster.groups.index(group.name)
        self._start = self.environment.roster.start(group.name)
        self._delay = nanoseconds(self.parameters.delay)
        self._late: deque[Reading] = deque()
        #: What was true at the turn before, as `present` returned it; None before the first.
        self._before: Any = None

    @abstractmethod
    def measure(self, present: Any) -> Reading:
        """Measure the world as it is now.

        Args:
            present: What `present` returned.
        """

    def present(self) -> Any:
        """What is true now that the next measurement will be compared with, for sensors that compare."""
        return None

    def _compute(self) -> tuple[Reading, Any]:
        present = self.present()
        return self.measure(present), present

    def _update(self, value: tuple[Reading, Any]) -> None:
        reading, self._before = value
        late, found = self._late, None
        late.append(reading)
        while late and late[0].time + self._delay <= self.computed_at:
            found = late.popleft()
        if found is not None:
            self._group.awareness.readings[self.name] = found
