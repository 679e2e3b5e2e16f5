"""Transfers state between the process of a run and its workers, which have counterparts of the same objects."""

from __future__ import annotations

import pickle
from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from symaware_cli.awareness import SeriesColumn
from symaware_cli.engine.runtime.state.counterparts import NOTHING, Counterparts
from symaware_cli.engine.runtime.state.deserialiser import Deserialiser
from symaware_cli.engine.runtime.state.layout import layout
from symaware_cli.engine.runtime.state.serialiser import Serialiser

if TYPE_CHECKING:
    from symaware_cli.core import AgentGroup
    from symaware_cli.engine.runtime.simulation import Simulation


class Transfer:
    """One end of a transfer between two processes of a run.

    Both ends give the same names to objects that both have. A reference to such an object becomes a reference to its
    counterpart at the other end; the object itself is not sent.
    """

    def __init__(self, packages: Collection[str]) -> None:
        """Create an end without named objects.

        Args:
            packages: The packages whose objects can be sent, besides data classes.
        """
        self._packages = packages
        self._named: dict[str, Any] = {}
        self._names: dict[int, str] = {}

    def name(self, named: Mapping[str, Any]) -> None:
        """Give names to objects that exist as long as this end does."""
        self._named |= named
        self._names |= {id(value): name for name, value in named.items()}

    def taken(self, names: Iterable[str], values: Mapping[str, Any] | None = None) -> bytes:
        """Serialise the state of some named objects, and further values by name.

        Raises:
            StateError: An object cannot be captured; the message gives its path.
        """
        root = {name: self._named[name] for name in names} | dict(values or {})
        # The other end belongs to this run; entries are plain, and pickle writes them fastest.
        return pickle.dumps(Serialiser(root, self._packages, self._names).entries, 5)

    def put(self, data: bytes) -> dict[str, Any]:
        """Restore the state of named objects in their counterparts here; return these and the values, by name.

        Raises:
            StateError: An object cannot be created here; nothing was changed.
        """
        entries = pickle.loads(data)
        names = entries[0][2][::2]
        root = {name: self._named.get(name, NOTHING) for name in names}
        return dict(
            zip(names, Deserialiser(Counterparts(entries, root, self._packages, self._named)).restore(), strict=True)
        )


def settle(group: AgentGroup) -> None:
    """Compute the pending values of a group's series, before its state is captured."""
    for column in group.awareness.columns.values():
        if isinstance(column, SeriesColumn):
            column.settle()


def packages(simulation: Simulation, others: Iterable[object] = ()) -> frozenset[str]:
    """The top-level packages of the classes of a simulation's plugins, and of other objects."""
    plugins: list[object] = [
        simulation.environment,
        *(each for entry in simulation.entries for each in entry.components),
    ]
    plugins += [group.model for group in simulation.groups]
    network = simulation.exchange.network
    plugins += [] if network is None else network.topologies
    plugins += others
    return frozenset({"symaware_cli", *(layout(type(each)).package for each in plugins)})
