"""A contact sensor: the number of bodies that touch an agent, and the impulse of impacts."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from symaware_cli.awareness import MEASUREMENT
from symaware_cli.core import AgentGroup, Contact, Event, Quantity, Signal
from symaware_cli.engine.components.sensor import Sensor, SensorParameters
from symaware_cli.geometry import Array

QUANTITIES = (Quantity("touching", "1"), Quantity("impulse", "N s"))


class ContactSensor(Sensor):
    """Measures how many bodies touch the agent, and the greatest impulse of an impact since the previous turn.

    Bodies are other agents, entities and the ground; as with all contacts, the ground does not count for an agent that
    rests on it at the start, until it has left it, and bodies touch until they have been apart for the `debounce` of
    the world. The impulse is the greatest of the impacts since the previous turn, also of those within one contact,
    with a normal error if there was one; in `kinematic`, which has no forces, it is 0.

    It records its measurements as a signal under its own name, and updates nothing else.
    """

    signals = (Signal(MEASUREMENT, "vector", QUANTITIES, description="as measured", nan="the measurement was missed"),)

    class Parameters(SensorParameters):
        """Parameters of the sensor."""

        noise: float = Field(0.0, ge=0, description="Standard deviation of the impulse [N s].")

    def initialise_component(self, group: AgentGroup) -> None:
        """Subscribe to the contacts of the world."""
        super().initialise_component(group)
        self._rows = {id: row for row, id in enumerate(group.ids)}
        #: The names of the bodies that each agent touches.
        self._touching: list[set[str]] = [set() for _ in group.ids]
        #: The row and impulse of each contact that began since the previous turn.
        self._hits: list[tuple[int, float]] = []
        self._surroundings.events.subscribe("contact", self._on_contact, "environment")
        self._surroundings.events.subscribe("touching", self._on_touch, "environment")

    def _on_contact(self, event: Event) -> None:
        contact = event.subject
        assert isinstance(contact, Contact)
        for one, other in ((contact.first, contact.second), (contact.second, contact.first)):
            if one in self._rows:
                others = self._touching[self._rows[one]]
                others.add(other) if contact.begins else others.discard(other)

    def _on_touch(self, event: Event) -> None:
        """Store the impulse of every impact, also of those within one contact."""
        contact = event.subject
        assert isinstance(contact, Contact)
        if contact.begins:
            self._hits += [
                (self._rows[id], contact.impulse) for id in (contact.first, contact.second) if id in self._rows
            ]

    def present(self) -> int:
        """Return the number of impacts since the previous turn."""
        return len(self._hits)

    def _update(self, value: tuple[Array, int]) -> None:
        super()._update(value)
        del self._hits[: value[1]]

    def measure(self, present: int) -> Array:
        """Return the number of touching bodies and the greatest impulse of each agent; shape (n, 2)."""
        parameters, hits = self.parameters, np.zeros(len(self._group))
        for row, impulse in self._hits[:present]:
            hits[row] = max(hits[row], impulse)
        if parameters.noise:
            errors = parameters.noise * self.random.standard_normal(1, "noise")[:, 0]
            hits = np.where(hits > 0.0, np.maximum(hits + errors, 0.0), 0.0)
        values = np.stack([np.array([len(others) for others in self._touching], float), hits], axis=1)
        return self.with_dropouts(values)
