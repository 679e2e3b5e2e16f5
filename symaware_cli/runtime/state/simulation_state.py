"""The state of a simulation between two steps: captured, written to bytes and read, restored."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from symaware_cli.core.stateful import StateError
from symaware_cli.runtime.protected_rows import ProtectedRows
from symaware_cli.runtime.state.counterparts import Counterparts
from symaware_cli.runtime.state.deserialiser import Deserialiser
from symaware_cli.runtime.state.serialiser import Entry, Serialiser
from symaware_cli.runtime.state.transfer import packages, settle

if TYPE_CHECKING:
    from symaware_cli.runtime.run import Run

#: The first bytes of a stored state.
_MAGIC = b"SymAware state 1\n"


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
            StateError: The state contains a text that is not valid Unicode.
        """
        # Imported here, because the code for frames is slow to load.
        from symaware_cli.network.value import value_to_wire

        try:
            data = value_to_wire({**vars(self), "entries": [list(each) for each in self.entries]}).SerializeToString()
        except TypeError as error:
            raise StateError(f"the state cannot be written: {error}") from error
        return _MAGIC + zlib.compress(data, 1)

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        """Read the bytes that `to_bytes` wrote.

        Raises:
            StateError: The bytes are not a state, or are damaged.
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


def capture(run: Run, scenario: str, version: str) -> SimulationState:
    """Capture the state of a run between two steps.

    Args:
        run: The run; it has begun.
        scenario: The digest of its scenario.
        version: The version of the package.

    Raises:
        StateError: The run is over, or an object cannot be captured; the message gives its path.
    """
    _check(run)
    entries = Serialiser(_roots(run), packages(run.simulation)).entries
    substitutes = [each.label for each in run.simulation.entries if each.is_substitute and each.is_initialised]
    return SimulationState(scenario, version, run.simulation.clock.now, run.done, substitutes, entries)


def restore(run: Run, state: SimulationState, scenario: str, version: str, seed: int | None = None) -> None:
    """Restore a state in the run in which it was captured, or in another one of the same scenario.

    Args:
        run: The run; it has begun. If it is over, it goes on from the state.
        state: The state.
        scenario: The digest of the scenario of the run.
        version: The version of the package.
        seed: What is drawn from then on; None for the seed of the state, as if nothing had been restored.

    Raises:
        StateError: The state is of another scenario or version, or cannot be restored here. Nothing was changed.
    """
    if run.status is None:
        _check(run)
    if state.version != version:
        raise StateError(f"the state was captured by version {state.version} of the package, and this is {version}")
    if state.scenario != scenario:
        raise StateError("the state belongs to another scenario, to other overrides of it, or to another seed")
    if run.status is not None:
        run.check_reopening()
    for entry in run.simulation.entries:
        if entry.label in state.substitutes and not entry.is_initialised:
            # What a component makes as it is initialised, such as a solver, is a counterpart of what was captured.
            with ProtectedRows(entry.group, range(len(entry.group))):
                entry.initialise()
    deserialiser = Deserialiser(Counterparts(state.entries, _roots(run), packages(run.simulation)))
    if run.status is not None:
        run.reopen()
    deserialiser.restore()
    if seed is not None:
        deserialiser.reseed(seed)


def _check(run: Run) -> None:
    """Check that the run is not over, and compute pending values."""
    if run.status is not None:
        raise StateError(f"the run of {run.simulation.name} is over: {run.status}")
    for group in run.simulation.groups:
        settle(group)


def _roots(run: Run) -> Mapping[str, Any]:
    """The root objects of a run's state; the first one that refers to an object gives it its path in messages."""
    simulation = run.simulation
    return {
        **{f"the group {group.name}": group for group in simulation.groups},
        "the environment": simulation.environment,
        "the exchange": simulation.exchange,
        **{
            component.path + entry.label.removeprefix(entry.path): component
            for entry in simulation.entries
            for component in entry.components
        },
        "the run": run,
        **({"the log": run.recorder} if run.recorder else {}),
    }
