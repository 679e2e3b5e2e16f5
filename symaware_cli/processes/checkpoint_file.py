"""The file in which a member stores the state from which it can continue if its process dies.

Reasons: docs/decisions/0063-members-that-continue.md
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

from symaware_cli.core.stateful import StateError
from symaware_cli.engine import LARGEST_STATE, FrameError, SimulationState, parsed, value_from_wire, value_to_wire
from symaware_cli.engine.network import transport_pb2 as wire
from symaware_cli.log import reason, whole_file
from symaware_cli.processes.frame import Checkpoint
from symaware_cli.processes.participant import Identity

#: The first bytes of the file. The SHA-256 of the rest follows, then the content.
_MAGIC = b"SymAware checkpoint 1\n"

_HEAD = len(_MAGIC) + hashlib.sha256().digest_size

#: The most bytes of a file: a state, and what describes it.
_LARGEST = LARGEST_STATE + 2**20

_TYPES = {"run": bytes, "name": str, "scenario": bytes, "version": str, "agents": list, "state": bytes}


class CheckpointFile:
    """The stored state of one member.

    Attributes:
        path: The file, in the folder of the member's log.
    """

    def __init__(self, folder: Path, scenario: str, identity: Identity) -> None:
        """Initialise; nothing is read or written.

        Args:
            folder: The folder of the log.
            scenario: The name of the scenario.
            identity: The member.
        """
        self._identity = identity
        self.path = folder / f"{scenario}.{quote(identity.name, safe='*?[]+,')}.state"

    def write(self, run: bytes, state: SimulationState) -> None:
        """Replace the file, at once or not at all.

        Args:
            run: The random bytes that the host drew for the run.
            state: The state of the member.

        Raises:
            StateError: The state cannot be written to bytes.
            LogError: The file cannot be written.
        """
        identity = self._identity
        content = {
            "run": run,
            "name": identity.name,
            "scenario": identity.scenario,
            "version": identity.version,
            "agents": list(identity.agents),
            "state": state.to_bytes(),
        }
        data = value_to_wire(content).SerializeToString()
        with whole_file(self.path) as partial:
            partial.write_bytes(_MAGIC + hashlib.sha256(data).digest() + data)

    def read(self) -> tuple[Checkpoint, SimulationState] | None:
        """Read the file; None if there is none.

        Raises:
            StateError: It is damaged, or not of this member; names the file.
        """
        try:
            return self._read()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise StateError(f"{self.path} cannot be read: {reason(error)}") from error
        except StateError as error:
            raise StateError(f"{self.path} cannot be used: {error}") from error

    def _read(self) -> tuple[Checkpoint, SimulationState]:
        if self.path.exists() and not self.path.is_file():
            raise StateError("it is not a file")
        with self.path.open("rb") as file:
            data = file.read(_LARGEST + 1)
        if len(data) > _LARGEST:
            raise StateError(f"it is larger than {_LARGEST:,} bytes")
        if not data.startswith(_MAGIC):
            raise StateError("it is not the state of a member, or that of another version of SymAware")
        if hashlib.sha256(data[_HEAD:]).digest() != data[len(_MAGIC) : _HEAD]:
            raise StateError("it is damaged: its checksum is wrong")
        try:
            found: Any = value_from_wire(parsed(wire.Value, data[_HEAD:]))
        except FrameError as error:
            raise StateError(f"it is damaged: {error}") from error
        is_whole = type(found) is dict and {key: type(each) for key, each in found.items()} == _TYPES
        if not is_whole:
            raise StateError("it has not the content of the state of a member")
        identity = self._identity
        for key, what, own in (
            ("version", "SymAware", identity.version),
            ("scenario", "another scenario, or other overrides or another seed", identity.scenario),
            ("name", "the process", identity.name),
            ("agents", "other agents", list(identity.agents)),
        ):
            if found[key] != own:
                said = f"{what} {found[key]}" if key in ("version", "name") else what
                raise StateError(f"it is of {said}")
        state = SimulationState.from_bytes(found["state"])
        return Checkpoint(found["run"], state.steps), state

    def remove(self) -> None:
        """Remove the file, as the run is over."""
        with suppress(OSError):
            self.path.unlink()
