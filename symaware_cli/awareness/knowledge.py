"""Knowledge: information of an agent beyond its situational awareness, such as its goal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness.readonly import readonly
from symaware_cli.world import frozen, real

Array = NDArray[np.float64]


class Changes:
    """Tracks the changes in the knowledge of a group, so that readers need not compare all of it.

    Attributes:
        rows: The agents whose knowledge changed since the last record.
    """

    __slots__ = ("_watchers", "rows")

    def __init__(self) -> None:
        self.rows: set[int] = set()
        self._watchers: dict[str, list[set[int]]] = {}

    def watch(self, name: str) -> set[int]:
        """Return a set to which each agent is added whose entry of a name changes from now on."""
        stale: set[int] = set()
        self._watchers.setdefault(name, []).append(stale)
        return stale

    def note(self, row: int, names: Iterable[str]) -> None:
        """Record that some entries of an agent's knowledge changed."""
        self.rows.add(row)
        for name in names if self._watchers else ():
            for stale in self._watchers.get(name, ()):
                stale.add(row)


class KnowledgeDatabase(dict[str, Any]):
    """The knowledge of one agent by name, which tracks its changes.

    Values are deeply read-only: lists are returned as tuples, and arrays and mappings cannot be changed. To change an
    entry, assign it, as in ``self_knowledge["bag"] = [*self_knowledge["bag"], "key"]``, so that the log and other
    components notice the change.

    Attributes:
        changed: Whether an entry was set or removed since this was last set to False.
    """

    __slots__ = ("_changes", "_row", "changed")

    def __init__(self, entries: Mapping[str, Any] | None = None, row: int = 0, changes: Changes | None = None) -> None:
        """Create the knowledge with initial entries.

        Args:
            entries: The entries.
            row: The row of the agent in its group.
            changes: Records every change.

        Raises:
            ValueError: An entry contains itself.
        """
        super().__init__({name: readonly(value, name) for name, value in (entries or {}).items()})
        self._row = row
        self._changes = Changes() if changes is None else changes
        self._note(self)

    def _note(self, names: Iterable[str]) -> None:
        self.changed = True
        self._changes.note(self._row, names)

    def __setitem__(self, name: str, value: Any) -> None:
        super().__setitem__(name, readonly(value, name))
        self._note((name,))

    def __delitem__(self, name: str) -> None:
        super().__delitem__(name)
        self._note((name,))

    def __ior__(self, other: Any) -> Self:  # type: ignore[override, misc]
        self.update(other)
        return self

    def __missing__(self, name: str) -> Any:
        known = ", ".join(sorted(self)) or "nothing"
        raise KeyError(f"the agent does not know `{name}`; it knows {known}")

    def update(self, *args: Any, **kwargs: Any) -> None:
        """Set several entries at once."""
        entries = {name: readonly(value, name) for name, value in dict(*args, **kwargs).items()}
        super().update(entries)
        self._note(entries)

    def replace(self, entries: Mapping[str, Any]) -> None:
        """Replace all entries."""
        names = [*self, *entries]
        super().clear()
        super().update({name: readonly(value, name) for name, value in entries.items()})
        self._note(names)

    def pop(self, name: str, *default: Any) -> Any:
        """Remove an entry and return it."""
        self._note((name,))
        return super().pop(name, *default)

    def popitem(self) -> tuple[str, Any]:
        """Remove the entry that was set last and return it with its name."""
        name, value = super().popitem()
        self._note((name,))
        return name, value

    def clear(self) -> None:
        """Remove all entries."""
        self.replace({})

    def setdefault(self, name: str, default: Any = None) -> Any:
        """Return an entry, set to the default if there was none."""
        if name not in self:
            self[name] = default
        return self[name]


class KnownColumn:
    """One entry of the knowledge of all agents of a group, as an array that is rebuilt only after changes."""

    __slots__ = ("_counts", "_databases", "_is_ragged", "_name", "_stale", "_values")

    def __init__(self, databases: Sequence[KnowledgeDatabase], name: str, changes: Changes) -> None:
        """Start to watch an entry.

        Args:
            databases: The knowledge of each agent.
            name: The name of the entry.
            changes: Records the changes in them.
        """
        self._databases = databases
        self._name = name
        self._stale = changes.watch(name)
        self._values: Array | None = None
        self._counts: NDArray[np.intp] | None = None
        self._is_ragged = False

    @property
    def values(self) -> Array:
        """One array, the same object as long as no value changes; shape (n, ...), read-only.

        Raises:
            KeyError: An agent does not know it.
            ValueError: The values are not numbers of one shape.
        """
        values, _ = self.padded
        if self._is_ragged:
            raise self._misshapen()
        return values

    @property
    def padded(self) -> tuple[Array, NDArray[np.intp]]:
        """Like `values`, for lists that may differ in length: shorter ones are padded by their last element.

        Empty lists are padded by zeros; if all are empty, the shape is (n, 0).

        Returns: The values, shape (n, longest, ...), and the length of each list, shape (n,).

        Raises:
            KeyError: An agent does not know it.
            ValueError: The values are not numbers, or their shapes differ in more than the length.
        """
        if self._stale or self._values is None or self._counts is None:
            self._values, self._counts = self._renewed()
            self._stale.clear()
        return self._values, self._counts

    def _renewed(self) -> tuple[Array, NDArray[np.intp]]:
        """Return the present values; the previous arrays if equal values were assigned again."""
        values, counts = self._values, self._counts
        if values is None or counts is None:
            return self._read()
        if 4 * len(self._stale) > len(values):
            now, others = self._read()
            same = now.shape == values.shape and np.array_equal(now, values) and np.array_equal(others, counts)
            return (values, counts) if same else (now, others)
        changed: dict[int, Array] = {}
        for row in self._stale:
            one = self._numbers(self._databases[row][self._name])
            if one.shape != values.shape[1:] or (one.ndim and counts[row] != len(one)):
                return self._read()
            if not (one == values[row]).all():
                changed[row] = one
        if changed:
            values = values.copy()
            for row, one in changed.items():
                values[row] = one
            values.flags.writeable = False
        return values, counts

    def _numbers(self, value: Any) -> Array:
        try:
            return real(value)
        except (TypeError, ValueError):
            raise self._misshapen() from None

    def _misshapen(self) -> ValueError:
        return ValueError(f"the knowledge `{self._name}` of the agents must be numbers of one shape")

    def _read(self) -> tuple[Array, NDArray[np.intp]]:
        each = [known[self._name] for known in self._databases]
        try:
            values = frozen(each)
        except TypeError:
            raise self._misshapen() from None
        except ValueError:
            pass  # lists of different lengths
        else:
            self._is_ragged = False
            return values, np.full(len(values), values.shape[1] if values.ndim > 1 else 1, np.intp)
        lists = [self._numbers(one) for one in each]
        shapes = {one.shape[1:] for one in lists if one.size}
        if len(shapes) != 1 or any(one.ndim < 2 for one in lists if one.size):
            raise self._misshapen()
        self._is_ragged = True
        counts = np.array([len(one) for one in lists], np.intp)
        nothing = np.zeros((1, *shapes.pop()))
        padded = [
            np.concatenate([one, np.repeat(one[-1:], counts.max() - len(one), axis=0)])
            if one.size
            else np.repeat(nothing, counts.max(), axis=0)
            for one in lists
        ]
        return frozen(padded), counts
