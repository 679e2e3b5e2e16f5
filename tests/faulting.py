"""Faults for tests that make a run without a scenario."""

from typing import Any, TypeVar

from simulating import STEP

from symaware_cli import Fault

Kind = TypeVar("Kind", bound=Fault)


def fault(
    kind: type[Kind], written: Any = None, at: int = 0, lasting: int | None = None, name: str = "fault", **resolved: Any
) -> Kind:
    """Make a fault as if it had been resolved in a scenario.

    Args:
        kind: Its class.
        written: The content under its key; by default the text ``*``.
        at: The step at which it begins.
        lasting: The number of steps that it lasts; None for the rest of the run.
        name: Its name.
        resolved: The attributes that `resolve` would set.
    """
    made = kind(kind.Parameters.model_validate("*" if written is None else written))
    made.kind, made.name = kind.__name__.lower(), name
    made.at, made.lasting = at * STEP, None if lasting is None else lasting * STEP
    vars(made).update(resolved)
    return made
