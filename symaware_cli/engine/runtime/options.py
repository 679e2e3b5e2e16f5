"""The options of a run: mode, pace, limits, faults, presence, specifications and workers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Literal

from symaware_cli.world import record

if TYPE_CHECKING:
    from symaware_cli.engine.runtime.fault import Fault
    from symaware_cli.engine.runtime.timing import PresenceInterval, Trigger
    from symaware_cli.specification import Specification
    from symaware_cli.specification.expression import Expression


@record
class RunOptions:
    """The options of a run, as declared in a scenario or given on the command line.

    Attributes:
        mode: ``synchronous`` or ``asynchronous``.
        until: The run ends with the first step after whose turns this condition holds.
        pace: Simulated seconds per second of wall time; None for as fast as possible.
        turn_limit: Wall time after which a turn counts as a failure of its component [s]; None for no limit.
        timeout: Wall time after which the run is interrupted [s]; None for no limit.
        faults: The faults.
        presence: The presence of the agents of some groups, by row; agents of other groups are always present.
        specifications: The specifications to monitor.
        instances: The events that begin instances of specifications, by the names of the specifications.
        workers: The number of worker processes for components with `run_in: process`; None for one per core.
        may_exit: Whether the process may be ended if the run does not react to a second signal or its time-out.
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
