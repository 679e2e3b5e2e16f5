"""Statuses of specifications during a run: verdict and robustness, as agents can read them."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol


class SpecificationStatus(NamedTuple):
    """The present status of a specification.

    Attributes:
        verdict: True if it is satisfied, False if it is violated, None while it is undecided.
        robustness: The exact robustness of its formula at the latest instant at which that is known; NaN before the
            first.
        interval: The least and the greatest that its robustness can still turn out to be; infinite where they are not
            computed.
    """

    verdict: bool | None
    robustness: float
    interval: tuple[float, float]


class SpecificationStatuses(Protocol):
    """The statuses of one specification, by agent."""

    @property
    def specification(self) -> Any:
        """The `symaware_cli.formulas.Specification`; None in a worker process."""

    def of(self, agent: str) -> SpecificationStatus | None:
        """The status for an agent: its own, the worst of its pairs, or the world's; None where it has none."""

    @property
    def worst(self) -> SpecificationStatus:
        """The worst of all."""
