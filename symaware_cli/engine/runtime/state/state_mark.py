"""A state that a simulation itself returns to, without being serialised.

`capture` makes plain data of a state, for other processes as well. A mark serves one simulation in one process, which
begins again and again: it refers to the objects of the simulation, and holds copies of the contents of mutable
ones. Returning to it copies these contents back, so objects keep their identities, and nothing has to be matched.

Reasons: docs/decisions/0083-learning.md
"""

from __future__ import annotations

import copy
import inspect
from collections import OrderedDict
from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any

import numpy as np

from symaware_cli.engine.runtime.state.layout import Layout, attributes, layout, set_attributes
from symaware_cli.engine.runtime.state.serialiser import Serialiser
from symaware_cli.world import Seed

#: Returns one object to its marked contents.
Return = Callable[[], object]


class StateMark:
    """The contents of all objects of a simulation that can change, at one instant."""

    def __init__(self, roots: Mapping[str, Any], packages: Collection[str]) -> None:
        """Copy the contents.

        Args:
            roots: The objects, by the names used in messages, with everything that they refer to.
            packages: See `Serialiser`.

        Raises:
            StateError: An object cannot be captured, as for `capture`; the message gives its path.
        """
        self._returns: list[Return] = []
        self._seeded: list[Any] = []
        #: Attributes of objects that have no others: the most frequent case, so it is a loop without calls.
        self._plain: list[tuple[dict[str, Any], dict[str, Any]]] = []
        #: Those of objects that have others without state, with the names of all that may be there.
        self._partial: list[tuple[dict[str, Any], dict[str, Any], frozenset[str]]] = []
        #: Collections that are empty at the mark.
        self._empty: list[tuple[Any, Callable[[Any], object]]] = []
        self._arrays: list[tuple[Any, Any]] = []
        #: The slots of objects that have no other attributes: what sets each, the object and the value.
        self._slots: list[tuple[Callable[[Any, Any], object], Any, Any]] = []
        for (kind, _, _), value in Serialiser(roots, packages).objects():
            if kind == "object":
                self._add_object(value)
            elif kind == "array":
                if value.flags.writeable and value.size:
                    self._arrays.append((value, value.copy(order="K")))
            elif kind in _RETURNS:
                clear = _CLEARS.get(type(value))
                if clear is not None and not value:
                    self._empty.append((value, clear))
                else:
                    self._returns.append(_RETURNS[kind](value))
                if kind in ("list", "dict", "set") and getattr(value, "__dict__", None):
                    self._add_attributes(value, layout(type(value)))

    def go_back(self, seed: Seed | None = None) -> None:
        """Return to the mark.

        Args:
            seed: What everything random is drawn from thereafter, for each run of a batch; None for the seed at the
                mark.
        """
        for own, marked in self._plain:
            if own.keys() != marked.keys():
                own.clear()
            own.update(marked)
        for own, marked, known in self._partial:
            for name in own.keys() - known:
                del own[name]
            own.update(marked)
        for assign, value, marked_value in self._slots:
            assign(value, marked_value)
        for value, clear in self._empty:
            if value:
                clear(value)
        for array, contents in self._arrays:
            if not array.flags.writeable:
                array.flags.writeable = True
            np.copyto(array, contents)
        for each in self._returns:
            each()
        if seed is not None:
            for each in self._seeded:
                each.reseed(seed)

    def _add_object(self, value: Any) -> None:
        of = layout(type(value))
        if hasattr(type(value), "reseed"):
            self._seeded.append(value)
        if of.captures_itself:
            self._add_attributes(value, of)
            state = copy.deepcopy(value.captured())
            self._returns.append(partial(_restore_if_changed if _is_text(state) else _restore_itself, value, state))
        elif not of.is_model:
            # Objects that do not change, such as snapshots, may have computed values that they keep.
            self._add_attributes(value, of)

    def _add_attributes(self, value: Any, of: Layout) -> None:
        if "*" in of.uncaptured:
            return
        marked = attributes(value, of)
        own = getattr(value, "__dict__", None)
        if own is None and marked.keys() == {*of.slots} - of.uncaptured:
            # Their descriptors, because frozen classes refuse assignments.
            kind = type(value)
            slots = [(inspect.getattr_static(kind, name).__set__, value, each) for name, each in marked.items()]
            self._slots.extend(slots)
        elif of.slots or type(own) is not dict:
            self._returns.append(partial(set_attributes, value, of, marked))
        elif of.uncaptured:
            self._partial.append((own, marked, of.uncaptured.union(marked)))
        else:
            self._plain.append((own, marked))


def _restore_itself(value: Any, state: Any) -> None:
    value.restored(copy.deepcopy(state))


def _restore_if_changed(value: Any, state: Any) -> None:
    if value.captured() != state:
        _restore_itself(value, state)


def _is_text(state: Any) -> bool:
    """Whether a state consists of texts in lists, and can be compared."""
    return isinstance(state, str) or (type(state) is list and all(map(_is_text, state)))


def _return_list(value: list[Any]) -> Return:
    return partial(list.__setitem__, value, slice(None), list(value))


def _return_deque(value: Any) -> Return:
    marked = list(value)

    def go_back() -> None:
        value.clear()
        value.extend(marked)

    return go_back


def _return_dict(value: Any) -> Return:
    marked = dict(value.items())
    ordered = OrderedDict if isinstance(value, OrderedDict) else None

    def go_back() -> None:
        if ordered is None:
            dict.clear(value)
            dict.update(value, marked)
            return
        ordered.clear(value)
        for key, each in marked.items():
            ordered.__setitem__(value, key, each)

    return go_back


def _return_set(value: set[Any]) -> Return:
    marked = set(value)

    def go_back() -> None:
        set.clear(value)
        set.update(value, marked)

    return go_back


def _return_objects(value: Any) -> Return:
    marked = value.copy()

    def go_back() -> None:
        if not value.flags.writeable:
            value.flags.writeable = True
        value[...] = marked

    return go_back if value.flags.writeable else lambda: None


def _return_generator(value: np.random.Generator) -> Return:
    marked = copy.deepcopy(value.bit_generator.state)
    return lambda: setattr(value.bit_generator, "state", marked)


def _return_cell(value: Any) -> Return:
    try:
        marked = value.cell_contents
    except ValueError:
        return lambda: None
    return lambda: setattr(value, "cell_contents", marked)


#: How collections of exactly these types are emptied.
_CLEARS: Mapping[type, Callable[[Any], object]] = {dict: dict.clear, list: list.clear, set: set.clear}

#: How objects of each kind of `Serialiser` get their marked contents back; those of other kinds cannot change.
_RETURNS: Mapping[str, Callable[[Any], Return]] = {
    "cell": _return_cell,
    "deque": _return_deque,
    "dict": _return_dict,
    "generator": _return_generator,
    "list": _return_list,
    "objects": _return_objects,
    "set": _return_set,
}
