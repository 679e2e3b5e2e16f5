"""Offers: specifications that agents can take over while a run goes on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Offer:
    """How a specification is offered.

    Attributes:
        at: When it is offered, in nanoseconds; None if an event brings it.
        open_for: How long it can be accepted, in nanoseconds; None for the rest of the run.
        epsilon: The probability with which whoever accepts it may fail it; None if nothing is said.
        to: The ids of the agents that the run tells of it; others learn of it by messages.
        knowledge: What comes with it, as plain values by name.
    """

    at: int | None
    open_for: int | None = None
    epsilon: float | None = None
    to: tuple[str, ...] = ()
    knowledge: Mapping[str, Any] = field(default_factory=dict)
