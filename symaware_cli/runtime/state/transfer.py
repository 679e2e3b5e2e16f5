"""State on its way between two processes that have counterparts of the same objects."""

from __future__ import annotations

import pickle
from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from symaware_cli.awareness.column import SeriesColumn
from symaware_cli.runtime.state.counterparts import NOTHING, Counterparts
from symaware_cli.runtime.state.layout import layout
from symaware_cli.runtime.state.putting import Putting
from symaware_cli.runtime.state.taking import Taking

if TYPE_CHECKING:
    from symaware_cli.core import AgentGroup
    from symaware_cli.runtime.simulation import Simulation


class Transfer:
    """One end of a pipe between two processes of a run.

    Both ends give the same names to what both have. What refers to such an object refers to its counterpart over there,
    and takes nothing of it along.
    """

    def __init__(self, packages: Collection[str]) -> None:
        """Begin without names.

        Args:
            packages: The packages of whose classes objects are sent, besides data classes.
        """
        self._packages = packages
        self._named: dict[str, Any] = {}
        self._names: dict[int, str] = {}

    def name(self, named: Mapping[str, Any]) -> None:
        """Give names to objects that stay for as long as this end does."""
        self._named |= named
        self._names |= {id(value): name for name, value in named.items()}

    def taken(self, names: Iterable[str], values: Mapping[str, Any] | None = None) -> bytes:
        """The state of some named objects, and some values by names of their own.

        Raises:
            StateError: Something cannot be taken; says where it stands.
        """
        root = {name: self._named[name] for name in names} | dict(values or {})
        # Whoever is at the other end is of this run; entries are plain, and pickle is the fastest to write them.
        return pickle.dumps(Taking(root, self._packages, self._names).entries, 5)

    def put(self, data: bytes) -> dict[str, Any]:
        """Put the state of named objects into their counterparts here, and return these and the values, by name.

        Raises:
            StateError: Something cannot be made here; nothing has changed.
        """
        entries = pickle.loads(data)
        names = entries[0][2][::2]
        root = {name: self._named.get(name, NOTHING) for name in names}
        return dict(zip(names, Putting(Counterparts(entries, root, self._packages, self._named)).put(), strict=True))


def settle(group: AgentGroup) -> None:
    """Compute what was left for later of a group's series, before its state is taken."""
    for column in group.awareness.columns.values():
        if isinstance(column, SeriesColumn):
            column.settle()


def packages(simulation: Simulation) -> frozenset[str]:
    """The packages that a simulation has classes of."""
    plugins: list[object] = [
        simulation.environment,
        *(each for entry in simulation.entries for each in entry.components),
    ]
    plugins += [group.model for group in simulation.groups]
    return frozenset({"symaware_cli", *(layout(type(each)).package for each in plugins)})
