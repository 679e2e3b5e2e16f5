"""The state of a simulation between two steps: taken, written to bytes and read again, put back."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from symaware_cli.core.stateful import StateError
from symaware_cli.runtime.state.counterparts import Counterparts
from symaware_cli.runtime.state.putting import Putting
from symaware_cli.runtime.state.taking import Entry, Taking
from symaware_cli.runtime.state.transfer import packages, settle

if TYPE_CHECKING:
    from symaware_cli.runtime.run import Run

#: What begins the bytes of a state.
_MAGIC = b"SymAware state 1\n"


@dataclass(frozen=True, eq=False, repr=False)
class SimulationState:
    """The state of a simulation at an instant at which no turn is in progress; made by `SteppedSimulation.capture`.

    It is plain data: `to_bytes` and `from_bytes` take it into another process, and nothing in it can run code.

    Attributes:
        scenario: The digest of the resolved scenario with its seed, which it can be put into again.
        version: That of the package that took it, which can read it.
        time: Simulated time [ns].
        steps: How many steps were made.
        entries: All values, as `Taking` lists them.
    """

    scenario: str
    version: str
    time: int
    steps: int
    entries: list[Entry]

    def to_bytes(self) -> bytes:
        """Write it, for `from_bytes` in any process.

        Raises:
            StateError: It holds a text that is no Unicode.
        """
        # Imported for those who need it: the code for frames is slow to load.
        from symaware_cli.network.value import value_to_wire

        try:
            data = value_to_wire({**vars(self), "entries": [list(each) for each in self.entries]}).SerializeToString()
        except TypeError as error:
            raise StateError(f"the state cannot be written: {error}") from error
        return _MAGIC + zlib.compress(data, 1)

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        """Read what `to_bytes` wrote.

        Raises:
            StateError: These bytes are no state.
        """
        from symaware_cli.network import transport_pb2 as wire
        from symaware_cli.network.value import FrameError, parsed, value_from_wire

        if not data.startswith(_MAGIC):
            raise StateError("these bytes are not the state of a simulation")
        try:
            found = value_from_wire(parsed(wire.Value, zlib.decompress(data[len(_MAGIC) :])))
            return cls(**{**found, "entries": [tuple(each) for each in found["entries"]]})
        except (FrameError, zlib.error, TypeError, KeyError) as error:
            raise StateError(f"the state of a simulation is damaged: {error}") from error

    def __repr__(self) -> str:
        return f"<SimulationState at {self.time / 1e9:g} s, step {self.steps:,}, {len(self.entries):,} entries>"


def take(run: Run, scenario: str, version: str) -> SimulationState:
    """Take the state of a run between two steps.

    Args:
        run: Under way.
        scenario: The digest of its scenario.
        version: That of the package.

    Raises:
        StateError: It is over, or something of it cannot be taken; says what.
    """
    _check(run)
    entries = Taking(_roots(run), packages(run.simulation)).entries
    return SimulationState(scenario, version, run.simulation.clock.now, run.done, entries)


def put(run: Run, state: SimulationState, scenario: str, version: str) -> None:
    """Put a state back into the run that it was taken of, or into another one of the same scenario.

    Raises:
        StateError: It is of another scenario or version, or something of it cannot be put here. Nothing has changed.
    """
    _check(run)
    if state.version != version:
        raise StateError(f"the state was taken by version {state.version} of the package, and this is {version}")
    if state.scenario != scenario:
        raise StateError("the state is one of another scenario, of other changes to it, or of another seed")
    Putting(Counterparts(state.entries, _roots(run), packages(run.simulation))).put()


def _check(run: Run) -> None:
    """Look whether there is a state, and compute what was left for later."""
    if run.status is not None:
        raise StateError(f"the run of {run.simulation.name} is over: {run.status}")
    for group in run.simulation.groups:
        settle(group)


def _roots(run: Run) -> Mapping[str, Any]:
    """All that the state of a run consists of; what comes first gives its name to what several refer to."""
    simulation = run.simulation
    return {
        **{f"the group {group.name}": group for group in simulation.groups},
        "the environment": simulation.environment,
        "the exchange": simulation.exchange,
        **{component.path: component for entry in simulation.entries for component in entry.components},
        "the run": run,
        **({"the log": run.recorder} if run.recorder else {}),
    }
