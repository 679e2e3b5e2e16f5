"""Captures the state of a run between two steps, and restores it.

Reasons: docs/decisions/0025-state-of-a-simulation.md
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from symaware_cli.core.stateful import StateError
from symaware_cli.engine.runtime.failure import describe
from symaware_cli.engine.runtime.fault import Fault
from symaware_cli.engine.runtime.protected_rows import ProtectedRows
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.engine.runtime.state.counterparts import Counterparts
from symaware_cli.engine.runtime.state.deserialiser import Deserialiser
from symaware_cli.engine.runtime.state.serialiser import Serialiser
from symaware_cli.engine.runtime.state.simulation_state import SimulationState
from symaware_cli.engine.runtime.state.state_mark import StateMark
from symaware_cli.engine.runtime.state.transfer import packages, settle
from symaware_cli.world import Seed


class Capturable(Protocol):
    """The parts of a run that are captured and restored.

    Attributes:
        simulation: The simulation.
        status: How the run ended; None while it has not.
    """

    simulation: Simulation
    status: str | None

    @property
    def faults(self) -> Sequence[Fault]:
        """The faults of the scenario."""

    @property
    def done(self) -> int:
        """The number of steps made."""

    @property
    def log_writers(self) -> Mapping[str, object]:
        """The objects that write the log and have state, by their names in messages; empty without a log."""

    def check_reopening(self) -> None:
        """Check that a run that is over can go on from a state; raises StateError."""

    def reopen(self) -> None:
        """Let a run that is over go on."""


#: What happens with entries that no capture makes, though the checksum is right.
_FORGED = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)


def capture(run: Capturable, scenario: str, version: str) -> SimulationState:
    """Capture the state of a run between two steps.

    Args:
        run: The run; it has begun.
        scenario: The digest of its scenario.
        version: The version of the package.

    Raises:
        StateError: The run is over, or an object cannot be captured; the message gives its path.
    """
    _check(run)
    entries = Serialiser(_roots(run, run.faults), _packages(run)).entries
    substitutes = [each.label for each in run.simulation.entries if each.is_substitute and each.is_initialised]
    return SimulationState(scenario, version, run.simulation.clock.now, run.done, substitutes, entries)


def restore(run: Capturable, state: SimulationState, scenario: str, version: str, seed: int | None = None) -> None:
    """Restore a state in the run in which it was captured, or in another one of the same scenario.

    Args:
        run: The run; it has begun. If it is over, it goes on from the state.
        state: The state.
        scenario: The digest of the scenario of the run.
        version: The version of the package.
        seed: The seed of draws from then on; None for the seed of the state, as if nothing had been restored.

    Raises:
        StateError: The state is of another scenario or version, or cannot be restored here. Nothing was changed, unless
            the message says so: then the state was forged, and the simulation has to be closed.
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
    try:
        # A branch may have more faults than the run in which the state was captured.
        captured = [each for each in run.faults if _label(each) in state.entries[0][2][::2]]
        deserialiser = Deserialiser(Counterparts(state.entries, _roots(run, captured), _packages(run)))
    except _FORGED as error:
        raise StateError(f"the state is not one that was captured: {describe(error)}") from error
    if run.status is not None:
        run.reopen()
    try:
        deserialiser.restore()
    except _FORGED as error:
        raise StateError(
            f"the state is not one that was captured: {describe(error)}; the simulation was changed in part: close it"
        ) from error
    if seed is not None:
        deserialiser.reseed(seed)


def mark(run: Capturable) -> StateMark:
    """Mark the state of a run between two steps, for `return_to`.

    Args:
        run: The run; it has begun.

    Raises:
        StateError: The run is over or writes a log, or an object cannot be captured; the message gives its path.
    """
    _check(run)
    run.check_reopening()
    return StateMark(_roots(run, run.faults), _packages(run))


def return_to(run: Capturable, marked: StateMark, seed: Seed | None = None) -> None:
    """Return to a state of the same run, which may be over.

    Args:
        run: The run.
        marked: The state.
        seed: The seed of draws from then on, for each run of a batch; None for the seed of the state, as if nothing had
            happened since.
    """
    run.reopen()
    marked.go_back(seed)


def _check(run: Capturable) -> None:
    """Check that the run is not over, and compute pending values."""
    if run.status is not None:
        raise StateError(f"the run of {run.simulation.name} is over: {run.status}")
    for group in run.simulation.groups:
        settle(group)


def _packages(run: Capturable) -> frozenset[str]:
    """The packages whose objects can be captured."""
    return packages(run.simulation, run.faults)


def _label(fault: Fault) -> str:
    return f"the fault {fault.name}"


def _roots(run: Capturable, faults: Sequence[Fault]) -> Mapping[str, Any]:
    """The root objects of a run's state; the first one that refers to an object gives it its path in messages."""
    simulation = run.simulation
    return {
        **{f"the group {group.name}": group for group in simulation.groups},
        "the environment": simulation.environment,
        "the exchange": simulation.exchange,
        **{
            component.path + entry.distinction: component
            for entry in simulation.entries
            for component in entry.components
        },
        "the run": run,
        **{_label(fault): fault for fault in faults},
        **run.log_writers,
    }
