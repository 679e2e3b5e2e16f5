"""Perception without errors: of the own state, or of all agents."""

from __future__ import annotations

from collections.abc import Mapping

from symaware_cli.core import GroupComponent, Snapshot
from symaware_cli.geometry import Array


class SelfPerception(GroupComponent):
    """Gives each agent its own exact state, and nothing about others."""

    batchable = True

    sees_world = True

    def perceives(self) -> Mapping[str, bool]:
        """The own state."""
        return {"own": True}

    def _compute(self) -> Array:
        return self.environment.state(self._group)

    def _update(self, value: Array) -> None:
        self._group.awareness.state = value


class OmniscientPerception(GroupComponent):
    """Gives each agent the exact states of all agents.

    All share one read-only snapshot of the world, so a step costs O(n), not O(n^2).
    """

    batchable = True

    sees_world = True

    def perceives(self) -> Mapping[str, bool]:
        """All states."""
        return {"own": True, "others": True}

    def _compute(self) -> Snapshot:
        return self.environment.snapshot()

    def _update(self, value: Snapshot) -> None:
        awareness = self._group.awareness
        awareness.state = value.states[value.roster.number(self._group.name)]
        awareness.world = value
        awareness.seen = None
