"""Links with additional losses and delays, or a lower bandwidth."""

from __future__ import annotations

import math
from typing import Self

from pydantic import Field, model_validator

from symaware_cli.core import nanoseconds
from symaware_cli.engine.faults.message_fault import LinkFault, LinkParameters
from symaware_cli.engine.runtime.fault import FaultContext


class Degrade(LinkFault):
    """Links with additional losses and delays, or a lower bandwidth."""

    class Parameters(LinkParameters):
        """Links with additional losses and delays, or a lower bandwidth."""

        loss: float = Field(0.0, ge=0, le=1, description="Probability of an additional loss.")
        delay: float = Field(0.0, ge=0, le=1e9, description="Additional delay of messages [s].")
        bandwidth: float | None = Field(
            None,
            gt=0,
            le=1e15,
            description="Upper limit of the bandwidth of each link [bytes/s]. By default there is no additional limit.",
        )

        @model_validator(mode="after")
        def _is_something(self) -> Self:
            if not self.loss and not self.delay and self.bandwidth is None:
                raise ValueError("say a `loss`, a `delay` or a `bandwidth`")
            return self

    @property
    def text(self) -> str:
        """Names the links."""
        return f"degrades the links {self.links}"

    @property
    def limits_bandwidth(self) -> bool:
        """Whether there is a bandwidth."""
        return self.parameters.bandwidth is not None

    @property
    def effect_before(self) -> str | None:
        """Links with a limit queue messages from the beginning."""
        if not self.limits_bandwidth:
            return None
        return f"the bandwidth of `{self.name}` acts from the beginning of a run"

    def resolve(self, context: FaultContext) -> None:
        """Find the senders and receivers."""
        super().resolve(context)
        self.loss, self.delay = self.parameters.loss, nanoseconds(self.parameters.delay)
        self.bandwidth = self.parameters.bandwidth or math.inf
