"""In which way a simulation is to run: what a scenario says under ``run`` and ``faults``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from symaware_cli.specification.expression import Expression

if TYPE_CHECKING:
    from symaware_cli.runtime.faults import Fault
    from symaware_cli.runtime.presence import PresenceInterval
    from symaware_cli.runtime.timing import Trigger
    from symaware_cli.specification.specification import Specification


@dataclass(frozen=True, slots=True)
class RunOptions:
    """In which way a simulation is to run.

    Attributes:
        mode: ``synchronous`` or ``asynchronous``.
        until: The run ends with the first step after whose turns this holds.
        pace: Simulated seconds for each second of wall time; None for as fast as possible.
        turn_limit: Wall time that a turn may take before its component counts as failed [s]; None for any.
        timeout: Wall time after which the run is ended [s]; None for never.
        faults: What is to go wrong.
        presence: When the agents of some groups are in the world, in the order of their rows; all others are always.
        specifications: What is monitored while it runs.
        instances: The events with which instances of specifications begin, by the names of these.
        workers: How many processes compute what is to compute in a process of its own; None for one for each core.
        may_exit: Whether the process may be ended where the run heeds neither a second signal nor its time-out.
    """

    mode: Literal["synchronous", "asynchronous"] = "synchronous"
    until: Expression | None = None
    pace: float | None = None
    turn_limit: float | None = None
    timeout: float | None = None
    faults: Sequence[Fault] = ()
    presence: Mapping[str, Sequence[PresenceInterval]] = field(default_factory=dict)
    specifications: Sequence[Specification] = ()
    instances: Mapping[str, Trigger] = field(default_factory=dict)
    workers: int | None = None
    may_exit: bool = True
