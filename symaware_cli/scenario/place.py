"""Where a process stands among those that share a run."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self


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

    @classmethod
    def host(
        cls,
        port: int,
        only: str | Sequence[str] = (),
        *,
        bind: str = "127.0.0.1",
        name: str | None = None,
        key_file: str | os.PathLike[str] | None = None,
        wait: float = 60.0,
    ) -> Self:
        """The place of the process that keeps the world.

        Args:
            port: Where it listens; 0 for any.
            only: Whom it runs itself: ids, groups or patterns.
            bind: The address at which it listens.
            name: What the others call it; by default ``host``.
            key_file: The key that all share; needed unless nothing but this machine is reached.
            wait: For how long it waits for the others [s].
        """
        address = f"[{bind}]:{port}" if ":" in bind else f"{bind}:{port}"
        return cls("host", address, _listed(only), name, _path(key_file), wait)

    @classmethod
    def member(
        cls,
        address: str,
        only: str | Sequence[str],
        *,
        name: str | None = None,
        key_file: str | os.PathLike[str] | None = None,
        wait: float = 60.0,
    ) -> Self:
        """The place of a process that joins.

        Args:
            address: Where the host listens, as ``HOST:PORT``.
            only: Whom it runs: ids, groups or patterns.
            name: What the others call it; by default, after whom it runs.
            key_file: The key that all share; needed unless nothing but this machine is reached.
            wait: For how long it tries to reach the host [s].
        """
        return cls("member", address, _listed(only), name, _path(key_file), wait)


def _listed(only: str | Sequence[str]) -> Sequence[str]:
    return [only] if isinstance(only, str) else only


def _path(file: str | os.PathLike[str] | None) -> Path | None:
    return None if file is None else Path(file)
