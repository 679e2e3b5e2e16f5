"""The state of a simulation between two steps, written to bytes and read."""

from __future__ import annotations

import hashlib
import zlib
from dataclasses import dataclass
from typing import Any, Self

from symaware_cli.core.stateful import StateError
from symaware_cli.engine.runtime.state.serialiser import Entry

#: The first bytes of a stored state. The SHA-256 of the rest follows, then the compressed content.
_MAGIC = b"SymAware state 2\n"

_HEAD = len(_MAGIC) + hashlib.sha256().digest_size

#: The most bytes of a state without compression.
LARGEST_STATE = 2**28

#: The type of each attribute of a state.
_TYPES = {"scenario": str, "version": str, "time": int, "steps": int, "substitutes": list, "entries": list}


@dataclass(frozen=True, eq=False, repr=False)
class SimulationState:
    """The state of a simulation at an instant at which no turn is in progress; made by `SteppedSimulation.capture`.

    It is plain data: `to_bytes` and `from_bytes` transfer it to another process, and nothing in it can run code.

    Attributes:
        scenario: The digest of the resolved scenario with its seed; the state can be restored in runs of it only.
        version: The version of the package that captured it; only that version can restore it.
        time: Simulated time [ns].
        steps: The number of steps made.
        substitutes: The components that have replaced others so far, by their path and the fault.
        entries: All values, as entries of `Serialiser`.
    """

    scenario: str
    version: str
    time: int
    steps: int
    substitutes: list[str]
    entries: list[Entry]

    def to_bytes(self) -> bytes:
        """Write the state to bytes, for `from_bytes` in any process.

        Raises:
            StateError: The state contains a text that is not valid Unicode, or is too large.
        """
        # Imported here, because the code for frames is slow to load.
        from symaware_cli.engine.network.value import value_to_wire

        try:
            data = value_to_wire({**vars(self), "entries": [list(each) for each in self.entries]}).SerializeToString()
        except TypeError as error:
            raise StateError(f"the state cannot be written: {error}") from error
        if len(data) > LARGEST_STATE:
            raise StateError(f"the state has {len(data):,} bytes, and may have {LARGEST_STATE:,} at most")
        compressed = zlib.compress(data, 1)
        return _MAGIC + hashlib.sha256(compressed).digest() + compressed

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        """Read the bytes that `to_bytes` wrote.

        Raises:
            StateError: The bytes are not a state, or are damaged.
        """
        from symaware_cli.engine.network import transport_pb2 as wire
        from symaware_cli.engine.network.value import FrameError, parsed, value_from_wire

        if not data.startswith(_MAGIC):
            raise StateError("these bytes are not the state of a simulation")
        compressed = data[_HEAD:]
        if hashlib.sha256(compressed).digest() != data[len(_MAGIC) : _HEAD]:
            raise StateError("the state of a simulation is damaged: its checksum is wrong")
        try:
            expanding = zlib.decompressobj()
            content = expanding.decompress(compressed, LARGEST_STATE)
            if not expanding.eof or expanding.unused_data:
                raise StateError(f"the state of a simulation is damaged, or larger than {LARGEST_STATE:,} bytes")
            found = value_from_wire(parsed(wire.Value, content))
        except (FrameError, zlib.error, RecursionError) as error:
            raise StateError(f"the state of a simulation is damaged: {error}") from error
        if not _is_state(found):
            raise StateError("these bytes have the form of a state, but not its content")
        return cls(**{**found, "entries": [tuple(each) for each in found["entries"]]})

    def __repr__(self) -> str:
        return f"<SimulationState at {self.time / 1e9:g} s, step {self.steps:,}, {len(self.entries):,} entries>"


def _is_state(found: Any) -> bool:
    """Whether a value has the attributes of a state, and entries of the right form that refer to entries."""
    if type(found) is not dict or found.keys() != _TYPES.keys():
        return False
    if not all(type(found[name]) is kind for name, kind in _TYPES.items()):
        return False
    entries = found["entries"]
    return bool(entries) and all(
        type(each) is list
        and [type(part) for part in each] == [str, str, list]
        and all(type(part) is not tuple or _refers(part, len(entries)) for part in each[2])
        for each in entries
    )


def _refers(reference: tuple[Any, ...], count: int) -> bool:
    return len(reference) == 1 and type(reference[0]) is int and 0 <= reference[0] < count
