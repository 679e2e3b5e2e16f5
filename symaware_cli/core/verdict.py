"""Statuses of specifications during a run: verdict and robustness, as agents can read them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple, Protocol


class SpecificationStatus(NamedTuple):
    """The present status of a specification.

    Attributes:
        verdict: True if it is satisfied, False if it is violated, None while it is undecided.
        robustness: The exact robustness of its formula at the latest instant at which that is known; NaN before the
            first.
        interval: The bounds that its final robustness can still lie within; infinite where they are not computed.
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

    def measured(self, agent: str) -> float:
        """The robustness on the samples of an agent up to now, with windows cut to these."""

    @property
    def began(self) -> int | None:
        """The instant at which its evaluation began, in nanoseconds; None before, and in a worker process."""

    @property
    def worst(self) -> SpecificationStatus:
        """The worst of all."""


#: The knowledge of an agent that lists the specifications that it was told are offered, by name.
OFFERS = "offers"


class OfferBoard(Protocol):
    """Accepts specifications that are offered."""

    @property
    def holders(self) -> Mapping[str, str]:
        """The ids of the agents that have accepted specifications and not given them up, by specification."""

    def accept(self, name: str, agent: str, path: str) -> bool:
        """Accept a specification for an agent, on behalf of the component with a path; whether the agent has it."""

    def open_to(self, group: str) -> Collection[str]:
        """The names of the specifications that agents of a group can accept now."""
