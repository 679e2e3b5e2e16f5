"""Where a process stands among those that share a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal


class DistributionError(Exception):
    """This process cannot take part in a run as it is asked to."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a process stands among those that share a run.

    Attributes:
        role: Whether it keeps the world, or joins who does.
        address: Where the host listens, as ``HOST:PORT``.
        only: Whom this process runs: ids, groups or patterns, with or without ``agents.`` before them.
        name: What to call it; by default, after whom it runs.
        key: A file with the key that all share; None where nothing but this machine is reached.
        patience: For how long to wait for others before the run begins [s].
    """

    role: Literal["host", "member"]
    address: str
    only: Sequence[str] = ()
    name: str | None = None
    key: Path | None = None
    patience: float = 60.0
