"""Attributes a failure of a run to the component that caused it, if the exception does not name it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from symaware_cli.core import Component, GroupComponent, SubscriberError
from symaware_cli.runtime.failure import RunError, describe
from symaware_cli.runtime.queue import LivelockError

if TYPE_CHECKING:
    from symaware_cli.runtime.simulation import Simulation


def attribute_livelock(simulation: Simulation, error: LivelockError) -> RunError:
    """Name the components that trigger each other endlessly."""
    entries = [simulation.entries[place] for place in error.places if place >= 0]
    names = ", ".join(f"`{entry.path}`" for entry in entries)
    problem = f"no time passes any more: {names} take turn after turn at one instant"
    source, plugin = (entries[0].path, entries[0].use) if entries else ("run", "symaware")
    return RunError(source, plugin, simulation.clock.now, problem)


def attribute_subscriber_error(simulation: Simulation, error: SubscriberError) -> RunError:
    """Name the component whose event subscriber raised an exception, or otherwise the event."""
    cause = error.__cause__ or error
    problem = f"{error}: {describe(cause)}"
    owner = getattr(error.subscriber, "__self__", None)
    source, plugin = error.event.source, "subscriber"
    if isinstance(owner, Component | GroupComponent):
        source, plugin = owner.path, owner.use
    return RunError(source, plugin, simulation.clock.now, problem, cause)
