"""Latencies as they are written in scenarios: a number of seconds, or a distribution from which each one is drawn."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from symaware_cli.core import Parameters
from symaware_cli.engine.runtime.timing import Duration

Seconds = Annotated[float, Field(ge=0, le=1e9)]


class Drawn(Parameters):
    """A random duration, drawn each time."""

    uniform: tuple[Seconds, Seconds] | None = Field(None, description="Uniform distribution: [least, greatest] [s].")
    normal: tuple[Seconds, Seconds] | None = Field(
        None, description="Normal distribution: [mean, standard deviation], truncated at 0 [s]."
    )

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if (self.uniform is None) == (self.normal is None):
            raise ValueError("say either `uniform` or `normal`")
        if self.uniform is not None and self.uniform[0] > self.uniform[1]:
            raise ValueError("the least time comes first")
        return self


Latency = Seconds | Drawn


def duration_of(latency: float | Drawn) -> Duration:
    """Convert a constant or random latency."""
    if not isinstance(latency, Drawn):
        return Duration("constant", latency)
    if latency.uniform is not None:
        return Duration("uniform", *latency.uniform)
    assert latency.normal is not None
    return Duration("normal", *latency.normal)
