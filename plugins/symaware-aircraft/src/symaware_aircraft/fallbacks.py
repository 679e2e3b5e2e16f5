"""A metric of sweeps: how often the controller had to follow an old plan."""

from __future__ import annotations

from symaware_cli import Event, Metric


class Fallbacks(Metric):
    """Steps in which no solver found a plan within its budget, and the previous one was followed."""

    kind = "integer"
    version = 1

    def begin(self) -> None:
        """Count from zero."""
        self._count = 0
        self.subscribe("fell-back", self._on_fall_back)

    def value(self) -> int:
        """Return their number."""
        return self._count

    def _on_fall_back(self, event: Event) -> None:
        self._count += 1
