"""A controller that slows agents down by their risk."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from symaware_cli.core import AgentGroup, GroupComponent, Parameters
from symaware_cli.world.time import SECOND

Array = NDArray[np.float64]


class RiskAware(GroupComponent):
    """Slows down the motion requested by the preceding controller where the risk is high.

    Declare it after a controller and a risk estimator. The speed is unchanged up to the risk ``caution``, decreases
    linearly to zero at ``bound``, and agents stand still above. It decreases at once but recovers at a limited rate: an
    agent that slows down is at less risk, and would otherwise alternate between starting and stopping at every step.
    The intent stays that of the controller: where the agent wants to go, not at which speed.
    """

    batchable = True

    events: ClassVar = {
        "slowed": "An agent began to go slower than it wants to, because of the risk.",
        "stopped": "An agent that was slowed stopped altogether, for the first time since.",
        "resumed": "An agent goes as fast as it wants to again.",
    }

    class Parameters(Parameters):
        """Thresholds of the risk, and the rate of recovery."""

        caution: float = Field(0.3, ge=0, description="Risk above which to slow down.")
        bound: float = Field(0.7, gt=0, description="Risk from which on to stop.")
        recovery: float = Field(
            1.0, gt=0, description="Greatest rise of the part of the speed that is left, from 0 to 1 [1/s]."
        )

        @model_validator(mode="after")
        def _caution_before_bound(self) -> RiskAware.Parameters:
            if self.caution >= self.bound:
                raise ValueError(f"caution ({self.caution:g}) must be less than bound ({self.bound:g})")
            return self

    def check(self, group: AgentGroup) -> None:
        """Check that the model supports slowing down."""
        state, count = group.initial_state, len(group)
        group.model.slowed(state, np.zeros((count, len(group.model.control_input))), np.full(count, 0.5))

    def initialise_component(self, group: AgentGroup) -> None:
        """Start at full speed."""
        super().initialise_component(group)
        self._factor = np.ones(len(group))
        self._stopped = np.zeros(len(group), bool)
        self._last: int | None = None
        self._requested: Array | None = None
        self._written: int | None = None

    def _compute(self) -> tuple[Array, Array, Array]:
        group, parameters = self._group, self.parameters
        risk = self._risk()
        wanted = np.clip((parameters.bound - risk) / (parameters.bound - parameters.caution), 0.0, 1.0)
        elapsed = 0.0 if self._last is None else (self.now - self._last) / SECOND
        factor = np.minimum(wanted, self._factor + parameters.recovery * elapsed)
        requested = group.control_input
        if group.control_column.writes == self._written and self._requested is not None:
            # No new request since the last turn: slow down the original one, not the one already slowed.
            requested = self._requested
        return requested, group.model.slowed(group.awareness.state, requested, factor), factor

    def _update(self, value: tuple[Array, Array, Array]) -> None:
        self._requested, slowed, factor = value
        self._group.control_input = slowed
        self._written = self._group.control_column.writes
        self._last = self.computed_at
        self._emit_changes(factor)
        self._factor = factor

    def _emit_changes(self, factor: Array) -> None:
        """Emit events for agents that slow down, stop or resume."""
        before = self._factor
        stopped = (factor <= 0.0) & ~self._stopped
        changed = ((factor < 1.0) != (before < 1.0)) | stopped
        if not changed.any():
            return
        risk = self._risk()
        for row in np.flatnonzero(changed).tolist():
            if factor[row] < 1.0 <= before[row]:
                self.emit_for(row, "slowed", f"slowed down at a risk of {risk[row]:.2g}", risk=float(risk[row]))
            if stopped[row]:
                self.emit_for(row, "stopped", f"stopped at a risk of {risk[row]:.2g}", risk=float(risk[row]))
            if factor[row] >= 1.0:
                self.emit_for(row, "resumed", "goes at full speed again")
        self._stopped = (self._stopped | stopped) & (factor < 1.0)

    def _risk(self) -> Array:
        """Return the greatest risk in each agent's series; 0 if none is estimated; shape (n,)."""
        column = self._group.awareness.risk
        shared = column.shared
        if shared is not None:
            greatest: Array = shared[1].reshape(len(self._group), -1).max(axis=1)
            return greatest
        # A component of single agents wrote these, with Python objects for each agent anyway.
        series = [column.row(row).values for row in range(len(self._group))]
        return np.array([values.max() if values.size else 0.0 for values in series])
