"""Kinds of faults that fail."""

from __future__ import annotations

from typing import Any

from pydantic import field_validator

from symaware_cli import AgentParameters, Fault, FaultContext, FaultTargets, Parameters


class Abstract(Fault):
    """Lacks everything."""


class Sound(Fault):
    """One that does nothing."""

    @property
    def text(self) -> str:
        """What it does."""
        return "does nothing"

    def resolve(self, context: FaultContext) -> None:
        """Find nothing."""

    def begin(self, run: FaultTargets) -> Any:
        """Do nothing."""
        return [1.0]


class Unsuitable(Sound):
    """Does not fit any scenario."""

    Parameters = AgentParameters

    def resolve(self, context: FaultContext) -> None:
        """Refuse."""
        raise ValueError("the moon is in the wrong house")


class Crashes(Sound):
    """Cannot be checked."""

    def resolve(self, context: FaultContext) -> None:
        """Fail."""
        raise IndexError("list index out of range")


class Speechless(Sound):
    """Cannot say what it does."""

    @property
    def text(self) -> str:
        """Fail."""
        raise KeyError("text")


class RaisingParameters(Sound):
    """Has parameters that raise what no validator may."""

    class Parameters(Parameters):
        """One number."""

        speed: float

        @field_validator("speed")
        @classmethod
        def _look_up(cls, speed: float) -> float:
            return {1.0: 2.0}[speed]


class FalseStart(Sound):
    """Fails as it begins."""

    def begin(self, run: FaultTargets) -> Any:
        """Fail."""
        raise OSError("no wind")


class FalseEnd(Sound):
    """Fails as it ends."""

    def end(self, run: FaultTargets, begun: Any) -> None:
        """Fail."""
        raise SystemExit("enough")
