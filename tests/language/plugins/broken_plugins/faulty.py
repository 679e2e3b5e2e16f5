"""Can be imported, but is of no use."""

import asyncio
from typing import Any

from pydantic import Field, field_validator

from symaware_cli import AgentGroup, Component, Environment, GroupComponent, Model, Parameters, Part, Quantity


def function() -> None:
    """Not a class."""


class Stranger:
    """Not a component."""


class Abstract(Component):
    """Lacks `_update`."""

    def _compute(self) -> Any:
        return None


class _Idle(GroupComponent):
    def _compute(self) -> Any:
        return None

    def _update(self, value: Any) -> None:
        pass


class BadParameters(_Idle):
    """Has parameters that are not pydantic's."""

    class Parameters:
        """A plain class."""

        speed = 1.0


class RaisingParameters(_Idle):
    """Has a validator that fails in a way pydantic does not expect."""

    class Parameters(Parameters):
        """One parameter."""

        speed: float = Field(1.0, description="Speed [m/s].")

        @field_validator("speed")
        @classmethod
        def _look_up(cls, speed: float) -> float:
            return {1.0: 1.0}[speed]


class Refuses(_Idle):
    """Refuses a combination of parameters, with reason."""

    class Parameters(Parameters):
        """Two parameters."""

        low: float = Field(0.0, description="Low end [m].")
        high: float = Field(1.0, description="High end [m].")

    def __init__(self, parameters: Any = None) -> None:
        super().__init__(parameters)
        if self.parameters.low > self.parameters.high:
            raise ValueError("low must not lie above high")


class Crashes(_Idle):
    """Raises what its author did not think of."""

    def __init__(self) -> None:
        raise IndexError("list index out of range")


class Leaves(_Idle):
    """Leaves the interpreter."""

    def __init__(self) -> None:
        raise SystemExit(3)


class Unprintable(_Idle):
    """Raises what cannot say what it is."""

    def __init__(self) -> None:
        class WordlessError(Exception):
            def __str__(self) -> str:
                raise KeyboardInterrupt

        raise WordlessError


class CrashingCheck(_Idle):
    """Cannot even check."""

    def check(self, group: AgentGroup) -> None:
        """Fail."""
        raise ZeroDivisionError("division by zero")


class LeavingCheck(_Idle):
    """Raises what is no `Exception` instead of checking."""

    def check(self, group: AgentGroup) -> None:
        """Raise it."""
        raise asyncio.CancelledError


class CrashingQuantities(_Idle):
    """Cannot say what its series consist of."""

    def series_quantities(self, group: AgentGroup) -> Any:
        """Fail."""
        raise ZeroDivisionError("division by zero")


class NamelessQuantities(_Idle):
    """Says it with names alone."""

    def series_quantities(self, group: AgentGroup) -> Any:
        """Leave out the units."""
        return {"intent": ["x", "y"]}


class Taken(_Idle):
    """Calls a part of awareness as a log calls something else."""

    parts = (Part("control", columns=[Quantity("x", "m")]),)


class Riskier(_Idle):
    """Declares a part that every agent has in another way."""

    parts = (Part("risk", columns=[Quantity("x", "m")]),)


class Endless(_Idle):
    """Declares a vector and does not say how long it is."""

    parts = (Part("modes"),)


class PartNames(_Idle):
    """Declares parts by their names alone."""

    parts = ("modes",)


class Foreseeing(_Idle):
    """Names the columns of what is no part."""

    def series_quantities(self, group: AgentGroup) -> Any:
        """Say something of the future."""
        return {"future": [Quantity("x", "m")]}


class Stateless(Model):
    """Forgot to say what its state is."""

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        """Nothing changes."""
        return ()


class Misplaced(Model):
    """Has no element 1, where the position should be."""

    state = (Quantity("x", "m"),)
    control_input = (Quantity("velocity", "m/s"),)

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        """X' = u."""
        return (control_input[0],)


class Untimed(Environment):
    """Overrides __init__ and forgets the rest."""

    def __init__(self, parameters: Any = None) -> None:
        pass

    def step(self) -> None:
        """Nothing."""

    def state(self, group: AgentGroup) -> Any:
        """Nothing."""

    def applied_input(self, group: AgentGroup) -> Any:
        """Nothing."""

    def snapshot(self) -> Any:
        """Nothing."""


class BrokenSetup(Untimed):
    """Fails when everybody is put in place."""

    def __init__(self, parameters: Any = None) -> None:
        Environment.__init__(self, parameters)

    def initialise(self, groups: Any, obstacles: Any, seed: int) -> None:
        """Fail."""
        raise OSError("no display")


class Short(Stateless):
    """A model whose rates of change are fewer than its states."""

    state = (Quantity("x", "m"), Quantity("y", "m"), Quantity("heading", "rad"))
    control_input = (Quantity("speed", "m/s"),)

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        return [control_input[0], control_input[0]]
