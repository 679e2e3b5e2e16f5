"""The metric of sweeps from which `uncertainty.conformal` is calibrated."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from symaware_cli.components.uncertainty_conformal import ERROR
from symaware_cli.core import Metric, Parameters


class PredictionError(Metric):
    """The greatest error of predictions of others in a run, for each look-ahead; from `uncertainty.conformal`."""

    kind = "series"
    unit = "m"

    class Parameters(Parameters):
        """Whose predictions."""

        group: str | None = Field(
            None, description="The group of agents that predict; may be omitted if there is only one."
        )

    def begin(self) -> None:
        """Find the component.

        Raises:
            ValueError: There is none, or more than one.
        """
        named = self.parameters.group
        found = [
            (group, name)
            for group in self.groups
            for name in group.awareness.signals
            if name.endswith(f".{ERROR.name}") and named in (None, group.name)
        ]
        if len(found) != 1:
            where = f"of `{named}`" if named else "of the scenario"
            many = "several `uncertainty.conformal`; name the `group`" if found else "no `uncertainty.conformal`"
            raise ValueError(f"the agents {where} have {many}")
        self._group, self._name = found[0]

    def value(self) -> list[tuple[float, float]] | None:
        """Return pairs of look-ahead [s] and error [m]; None if no turn was taken."""
        tables = [each for each in self._group.awareness[self._name] if len(each)]
        if not tables:
            return None
        greatest = np.max([each[:, 1] for each in tables], axis=0)
        return list(zip(tables[0][:, 0].tolist(), greatest.tolist(), strict=True))
