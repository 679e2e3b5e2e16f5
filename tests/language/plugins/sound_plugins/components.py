"""Components that do nothing, with parameters of every kind."""

from typing import Any, ClassVar, Literal

from pydantic import Field, model_validator

from symaware_cli import Component, GroupComponent, Parameters


class Plain(Component):
    """A component without parameters."""

    def _compute(self) -> Any:
        return None

    def _update(self, value: Any) -> None:
        pass


class Watch(Component):
    """A component with parameters, and an __init__ that keeps them in its own way."""

    knowledge: ClassVar = {"post": "where to stand, as a position [m]"}

    class Parameters(Parameters):
        """How to watch."""

        range: float = Field(gt=0, description="How far it sees [m].")
        rays: int = Field(8, ge=1, le=360, description="How many rays it casts.")
        gains: list[float] = Field(default_factory=lambda: [1.0, 2.0], max_length=3, description="Gains [1/s].")
        weights: dict[str, float] = Field(default_factory=dict, description="Weight of each kind of thing.")
        mode: Literal["near", "far", "both"] = Field("both", description="What to look for.")
        quiet: bool = Field(False, description="Whether to keep silent.")
        label: str = Field("", description="What to call it.")
        reach: float | list[float] = Field(1.0, description="Reach, the same or for each axis [m].")

    def __init__(self, parameters: Any) -> None:
        self.kept = parameters

    def _compute(self) -> Any:
        return None

    def _update(self, value: Any) -> None:
        pass


class Band(GroupComponent):
    """A component with a rule over two parameters."""

    class Parameters(Parameters):
        """A band."""

        low: float = Field(0.0, description="Low end [m].")
        high: float = Field(1.0, description="High end [m].")

        @model_validator(mode="after")
        def _in_order(self) -> "Band.Parameters":
            if self.low > self.high:
                raise ValueError("high must not lie below low")
            return self

    def _compute(self) -> Any:
        return None

    def _update(self, value: Any) -> None:
        pass


class TwinOne(Plain):
    """One of two that are registered under the same name."""


class TwinTwo(Plain):
    """The other."""
