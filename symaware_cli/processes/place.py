"""The role of a process in a run of several processes: host or member, address, agents, key."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

if TYPE_CHECKING:
    from symaware_cli.language.build import Built
    from symaware_cli.processes.participant import Participant


@dataclass(frozen=True, slots=True)
class Place:
    """The role of a process in a run of several processes.

    Attributes:
        role: ``host`` for the process that runs the world, ``member`` for one that joins it.
        address: The address at which the host listens, as ``HOST:PORT``.
        only: The agents that this process runs: ids, groups or patterns, with or without the prefix ``agents.``.
        name: The name of the process; by default made of ``only``.
        key: A file with the shared key; None if only this machine can connect.
        patience: How long to wait for other processes before the run begins [s].
    """

    role: Literal["host", "member"]
    address: str
    only: Sequence[str] = ()
    name: str | None = None
    key: Path | None = None
    patience: float = 60.0

    @property
    def records_world(self) -> bool:
        """Whether this process records the world and all messages: the host does."""
        return self.role == "host"

    def take_part(self, stack: ExitStack, built: Built, log: Path | None) -> tuple[Participant, dict[str, Any]]:
        """Create the participant of this process, and the description of its part for the manifest.

        Args:
            stack: Closes the connections.
            built: The scenario.
            log: The log of this process; None for none.

        Raises:
            DistributionError: This process cannot have that role.
            TransportError: The other processes cannot be reached.
        """
        # Imported here, because the code for frames is slow to load.
        from symaware_cli.processes import distribution

        participant = distribution.participant(built, self, log)
        stack.callback(participant.port.close)
        return participant, distribution.part(self, participant)

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
        """The role of the process that runs the world.

        Args:
            port: The port at which it listens; 0 for any free port.
            only: The agents that it runs itself: ids, groups or patterns.
            bind: The address at which it listens.
            name: The name of the process; by default ``host``.
            key_file: A file with the shared key; required if other machines can connect.
            wait: How long it waits for the members [s].
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
        """The role of a process that joins the host.

        Args:
            address: The address at which the host listens, as ``HOST:PORT``.
            only: The agents that it runs: ids, groups or patterns.
            name: The name of the process; by default made of ``only``.
            key_file: A file with the shared key; required if the host is on another machine.
            wait: How long it tries to reach the host [s].
        """
        return cls("member", address, _listed(only), name, _path(key_file), wait)


def _listed(only: str | Sequence[str]) -> Sequence[str]:
    return [only] if isinstance(only, str) else only


def _path(file: str | os.PathLike[str] | None) -> Path | None:
    return None if file is None else Path(file)
