"""A contact sensor: whom an agent touches, and how hard it was hit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.awareness.signal import MEASUREMENT
from symaware_cli.components.sensor import Sensor, SensorParameters
from symaware_cli.core import AgentGroup, Contact, Event, Quantity, Signal

Array = NDArray[np.float64]

QUANTITIES = (Quantity("touching", "1"), Quantity("impulse", "N s"))


class ContactSensor(Sensor):
    """Feels how many bodies touch the agent, and how hard it was hit since the turn before.

    Bodies are other agents, entities and the ground; as with all contacts, what already lies on the ground at the start
    does not count before it has left it. The impulse is the greatest of the contacts that began since the turn before,
    with a normal error where there was one; in `kinematic`, which has no forces, it is 0.

    It hands out what it measures under its own name, and updates nothing else.
    """

    signals = (Signal(MEASUREMENT, "vector", QUANTITIES, description="as measured"),)

    class Parameters(SensorParameters):
        """What the sensor can do."""

        noise: float = Field(0.0, ge=0, description="Standard deviation of the impulse [N s].")

    def initialise_component(self, group: AgentGroup) -> None:
        """Begin to listen for contacts."""
        super().initialise_component(group)
        self._rows = {id: row for row, id in enumerate(group.ids)}
        #: Whom each agent touches.
        self._touching: list[set[str]] = [set() for _ in group.ids]
        #: Who was hit since the turn before, as a row, and how hard.
        self._hits: list[tuple[int, float]] = []
        self._surroundings.events.subscribe("contact", self._feel, "environment")

    def _feel(self, event: Event) -> None:
        contact = event.subject
        assert isinstance(contact, Contact)
        for one, other in ((contact.first, contact.second), (contact.second, contact.first)):
            row = self._rows.get(one)
            if row is None:
                continue
            if contact.begins:
                self._touching[row].add(other)
                self._hits.append((row, contact.impulse))
            else:
                self._touching[row].discard(other)

    def present(self) -> int:
        """How many hits were felt."""
        return len(self._hits)

    def _update(self, value: tuple[Array, int]) -> None:
        super()._update(value)
        del self._hits[: value[1]]

    def measure(self, present: int) -> Array:
        """Count who touches."""
        parameters, hits = self.parameters, np.zeros(len(self._group))
        for row, impulse in self._hits[:present]:
            hits[row] = max(hits[row], impulse)
        if parameters.noise:
            errors = parameters.noise * self.random.standard_normal(1, "noise")[:, 0]
            hits = np.where(hits > 0.0, np.maximum(hits + errors, 0.0), 0.0)
        values = np.stack([np.array([len(others) for others in self._touching], float), hits], axis=1)
        if parameters.dropout:
            values[self.random.uniform(1, "dropout")[:, 0] < parameters.dropout] = np.nan
        values.flags.writeable = False
        return values
