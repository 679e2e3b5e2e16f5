"""Base class of components that change what the controller before them requested."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, GroupComponent

Array = NDArray[np.float64]


class RequestFilter(GroupComponent):
    """A component that replaces the control inputs that the preceding controller requested.

    If the controller takes fewer turns, each turn of the filter starts from its original request, not from what the
    filter made of it before.
    """

    def initialise_component(self, group: AgentGroup) -> None:
        """Start without a request."""
        super().initialise_component(group)
        self._requested: Array | None = None
        self._written: int | None = None

    def _request(self) -> Array:
        """Return the control inputs that the controller requested last; shape (n, nu)."""
        if self._group.control_column.writes == self._written and self._requested is not None:
            return self._requested
        return self._group.control_input

    def _replace(self, requested: Array, control_input: Array) -> None:
        """Set the control inputs (n, nu) in place of the requested ones (n, nu)."""
        self._requested = requested
        self._group.control_input = control_input
        self._written = self._group.control_column.writes
