"""The result of one run in a sweep."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

#: ``done``: the run reached its end; ``failed``: a component, the world or a metric failed; ``lost``: its process died,
#: or it took too long.
State = Literal["done", "failed", "lost"]


@dataclass(frozen=True, slots=True)
class Row:
    """The result of a run.

    Attributes:
        index: The number of the run.
        state: The state in which it ended.
        verdicts: The outcome of each specification: ``satisfied``, ``violated``, ``undecided`` or ``rejected``.
        robustness: The robustness of each specification; None if unknown.
        metrics: The value of each metric.
        digest: A hash of the states and control inputs at every step, in hexadecimal; None unless it is done.
        error: Why the run is not done.
        trace: The traceback, if there is one.
        wall_time: The wall time of the run [s].
        log: The name of its log, if it was recorded.
    """

    index: int
    state: State
    verdicts: Mapping[str, str] = field(default_factory=dict)
    robustness: Mapping[str, float | None] = field(default_factory=dict)
    metrics: Mapping[str, Any] = field(default_factory=dict)
    digest: str | None = None
    error: str | None = None
    trace: str | None = None
    wall_time: float = 0.0
    log: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data, from which it can be recreated."""
        return asdict(self)
