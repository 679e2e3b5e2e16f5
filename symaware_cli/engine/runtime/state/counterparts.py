"""Matches the entries of a captured state with existing objects, by their paths; finds those to be created."""

from __future__ import annotations

import enum
import functools
import types
from collections import Counter, OrderedDict, defaultdict, deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, NoReturn

import numpy as np

from symaware_cli.core.stateful import StateError
from symaware_cli.engine.runtime.state.layout import attributes, format_class, layout, qualified_name, resolve
from symaware_cli.engine.runtime.state.serialiser import Entry, Path, format_path

#: Stands for no object.
NOTHING = object()

#: Python's built-in collections, which may have subclasses.
COLLECTIONS = {each.__name__: each for each in (list, tuple, deque, dict, set, frozenset)}

_KNOWN = (*COLLECTIONS.values(), Counter, OrderedDict, defaultdict)

_GENERATORS = frozenset({"MT19937", "PCG64", "PCG64DXSM", "Philox", "SFC64"})

#: Entries without references.
_SIMPLE = frozenset({"array", "int", "fixed", "enum", "same", "complex", "dtype", "range", "slice", "known"})

#: Kinds of entries whose objects can be created.
_MADE = frozenset({*COLLECTIONS, "object", "array", "objects", "view"})


class Counterparts:
    """The existing objects that correspond to serialised ones.

    Attributes:
        entries: The entries made by `Serialiser`.
        found: The existing objects, by the number of the entry.
        roots: The references of the root objects.
    """

    def __init__(
        self,
        entries: Sequence[Entry],
        root: Mapping[str, Any],
        packages: Collection[str],
        known: Mapping[str, Any] | None = None,
    ) -> None:
        """Find the counterparts of all entries.

        Args:
            entries: The entries that `Serialiser` made of a root with the same names.
            root: The existing objects, by name.
            packages: The packages whose classes may be instantiated, besides data classes.
            known: The objects known to `Serialiser`, by name. If given, the entries are only a part of the state, and
                all objects are created again except these, the root and those that cannot be created: an object that
                is the same must not have changed for those who compare identities.

        Raises:
            StateError: An object does not exist here and cannot be created; the message gives its path.
        """
        self.entries = entries
        self.found: dict[int, Any] = {}
        self.roots: list[Any] = []
        self._packages = packages
        self._claimed: set[int] = set()
        self._places: dict[int, Path] = {}
        self._makeable: dict[tuple[str, str], bool] = {}
        if known is not None:
            self.found.update((n, known[name]) for n, (kind, name, _) in enumerate(entries) if kind == "known")
            self._claimed.update(map(id, self.found.values()))
        self._find(root)
        if known is not None:
            stays = {each[0] for each in self.roots if type(each) is tuple}
            for number in [each for each in self.found if each not in stays and self._is_made(each)]:
                del self.found[number]
        for number in sorted(self._places.keys() - self.found.keys()):
            if not self._can_be_made(number):
                self._refuse(number)

    def _find(self, root: Mapping[str, Any]) -> None:
        contents = self.entries[0][2]
        there = dict(zip(contents[::2], contents[1::2], strict=True))
        missing = next((name for name in root if name not in there), None)
        if missing is not None:
            raise StateError(f"the state was captured in a run without {missing}")
        self.roots = [there[name] for name in root]
        waiting: list[tuple[Any, Any, Path, bool]] = [
            (there[name], root[name], (None, name), False) for name in reversed(list(root))
        ]
        while waiting:
            reference, live, path, is_fixed = waiting.pop()
            if type(reference) is not tuple:
                continue
            number = reference[0]
            self._places.setdefault(number, path)
            if number in self.found or id(live) in self._claimed or not self._fits(number, live):
                continue
            children = [*self._children(number, live, path)]
            if not is_fixed or not self._is_mutable(number, live):
                self.found[number] = live
                if not isinstance(live, type(None) | bool | int | float | str | bytes):
                    self._claimed.add(id(live))
            # Another model may share what this one contains, and neither may change.
            is_fixed |= self.entries[number][0] == "object" and layout(type(live)).is_model
            waiting.extend((*each, is_fixed) for each in reversed(children))
        # The paths of objects without a counterpart, for messages.
        for number in range(1, len(self.entries)):
            if number in self._places and number not in self.found:
                for reference, _, path in self._children(number, NOTHING, self._places[number]):
                    if type(reference) is tuple:
                        self._places.setdefault(reference[0], path)

    def _is_mutable(self, number: int, live: Any) -> bool:
        """Whether restoring an entry would change the existing object, and another one can be created instead."""
        kind = self.entries[number][0]
        if kind == "object":
            return not layout(type(live)).is_value and self._can_be_made(number)
        return kind in ("list", "deque", "dict", "set", "array", "objects", "view") and self._can_be_made(number)

    def _fits(self, number: int, live: Any) -> bool:
        """Whether an object matches an entry."""
        kind, name, contents = self.entries[number]
        match kind:
            case "object" | "list" | "tuple" | "deque" | "dict" | "set" | "frozenset" | "array" | "objects" | "view":
                if layout(type(live)).name != name:
                    return False
                return kind != "deque" or live.maxlen == contents[2 + contents[1]]
            case "enum":
                return qualified_name(type(live)) == name
            case "method":
                return isinstance(live, types.MethodType) and live.__func__.__name__ == name
            case "builtin":
                return isinstance(live, types.BuiltinFunctionType) and live.__name__ == name
            case "function":
                return isinstance(live, types.FunctionType) and qualified_name(live) == name
            case "fixed":
                if isinstance(live, types.ModuleType):
                    return live.__name__ + ":" == name
                return isinstance(getattr(live, "__qualname__", None), str) and qualified_name(live) == name
            case "cell":
                return isinstance(live, types.CellType)
            case "partial":
                return isinstance(live, functools.partial)
            case "generator":
                return isinstance(live, np.random.Generator) and type(live.bit_generator).__name__ == name
            case "same":
                return qualified_name(type(live)) == name
        return False

    def _children(self, number: int, live: Any, path: Path) -> Iterator[tuple[Any, Any, Path]]:
        """The contents of an entry, each with the existing object at that path (or `NOTHING`) and the path."""
        kind, _, contents = self.entries[number]
        stands = live is not NOTHING
        match kind:
            case "dict":
                yield from self._in_mapping(contents, live, path)
            case "object" | "list" | "tuple" | "deque" | "set" | "frozenset":
                yield from self._in_collection(kind, contents, live, path)
            case "objects":
                there = live.ravel().tolist() if stands else []
                yield from _in_order(contents[2:], there, path)
            case "view":
                yield contents[0], live.base if stands else NOTHING, path
            case "method" | "builtin":
                yield contents[0], live.__self__ if stands else NOTHING, path
            case "function":
                cells = (live.__closure__ or ()) if stands else ()
                for index, each in enumerate(contents):
                    yield each, cells[index] if index < len(cells) else NOTHING, path
            case "cell":
                for each in contents:
                    try:
                        yield each, live.cell_contents if stands else NOTHING, path
                    except ValueError:
                        yield each, NOTHING, path
            case "partial":
                for each, name in zip(contents, ("func", "args", "keywords"), strict=True):
                    yield each, getattr(live, name) if stands else NOTHING, (path, f".{name}")
            case _ if kind not in _SIMPLE:
                for each in contents:
                    yield each, NOTHING, path

    def _in_mapping(self, contents: Any, live: Any, path: Path) -> Iterator[tuple[Any, Any, Path]]:
        """The keys and values of a mapping, and its attributes; see `_children`."""
        held = contents[2 : 2 + contents[1]]
        keys = {self._key(key): key for key in live} if live is not NOTHING else {}
        for key, each in zip(held[::2], held[1::2], strict=True):
            plain = self._plain(key)
            known = keys.get(plain, NOTHING) if plain is not NOTHING else NOTHING
            place = (path, f"[{plain!r}]" if plain is not NOTHING else "[...]")
            yield key, known, place
            yield each, NOTHING if known is NOTHING else dict.__getitem__(live, known), place
        yield from _in_attributes(contents, live, path)

    @staticmethod
    def _in_collection(kind: str, contents: Any, live: Any, path: Path) -> Iterator[tuple[Any, Any, Path]]:
        """The elements of an object or a collection without keys, and its attributes; see `_children`."""
        held = contents[2 : 2 + contents[1]]
        if kind in ("set", "frozenset"):
            for each in held:
                yield each, NOTHING, (path, "{}")
        else:
            there = list(live) if live is not NOTHING and kind in ("list", "tuple", "deque") else []
            yield from _in_order(held, there, path)
        yield from _in_attributes(contents, live, path)

    def _key(self, key: Any) -> Any:
        """What identifies a key of a mapping: itself if it is plain, otherwise its identity."""
        return key if _is_plain_key(key) else ("object", id(key))

    def _plain(self, key: Any) -> Any:
        """The value of a plain key, or the identity of the counterpart of another one; otherwise `NOTHING`."""
        if type(key) is not tuple:
            return key
        number = key[0]
        kind, name, contents = self.entries[number]
        if kind == "int":
            return int(name)
        if kind == "enum":
            return resolve(name)[contents[0]]
        if kind == "tuple":
            parts = tuple(self._plain(each) for each in contents[2 : 2 + contents[1]])
            return NOTHING if any(each is NOTHING for each in parts) else parts
        live = self.found.get(number, NOTHING)
        return NOTHING if live is NOTHING else ("object", id(live))

    def _is_made(self, number: int) -> bool:
        return self.entries[number][0] in _MADE and self._can_be_made(number)

    def _can_be_made(self, number: int) -> bool:
        """Whether the object of an entry can be created."""
        kind, name, _ = self.entries[number]
        can = self._makeable.get((kind, name))
        if can is None:
            can = self._makeable[kind, name] = self._check_makeable(kind, name)
        return can

    def _check_makeable(self, kind: str, name: str) -> bool:
        found = resolve(name)
        if kind in COLLECTIONS or kind in ("array", "objects", "view"):
            base = COLLECTIONS.get(kind, np.ndarray)
            return found is np.ndarray or (
                isinstance(found, type) and issubclass(found, base) and (found in _KNOWN or self._is_known(found))
            )
        if kind == "object":
            return isinstance(found, type) and self._can_make(found)
        if kind in ("function", "fixed"):
            return name.endswith(":") or (found is not None and "<" not in name and qualified_name(found) == name)
        if kind == "generator":
            return name in _GENERATORS
        if kind == "enum":
            return isinstance(found, type) and issubclass(found, enum.Enum)
        return kind not in ("same", "known")

    def _refuse(self, number: int) -> NoReturn:
        kind, name, _ = self.entries[number]
        what = {"function": "function"}.get(kind, "object of the class")
        place = format_path(self._places.get(number))
        raise StateError(
            f"the state of {place} cannot be restored here: the {what} {format_class(name)} does not exist here, and "
            "cannot be created"
        )

    def _is_known(self, kind: type) -> bool:
        return layout(kind).package in self._packages

    def _can_make(self, kind: type) -> bool:
        of = layout(kind)
        return (
            (self._is_known(kind) or of.is_data)
            and of.is_plain
            and not of.uncaptured
            and not of.captures_itself
            and not hasattr(kind, "__del__")
        )


def _is_plain_key(key: Any) -> bool:
    if type(key) is tuple or (isinstance(key, tuple) and hasattr(key, "_fields")):
        return all(map(_is_plain_key, key))
    return isinstance(key, str | int | float | bytes | bool | type(None) | enum.Enum)


def _in_order(held: Sequence[Any], there: Sequence[Any], path: Path) -> Iterator[tuple[Any, Any, Path]]:
    """The elements of a sequence; the live one may have fewer."""
    for index, each in enumerate(held):
        yield each, there[index] if index < len(there) else NOTHING, (path, f"[{index}]")


def _in_attributes(contents: Any, live: Any, path: Path) -> Iterator[tuple[Any, Any, Path]]:
    """The contents of an object besides its elements: its attributes and its class."""
    rest = contents[2 + contents[1] :]
    if len(rest) % 2:  # the length of a deque, or the default factory of a mapping
        yield rest[0], getattr(live, "default_factory", NOTHING), path
        return
    own = attributes(live, layout(type(live))) if live is not NOTHING else {}
    for name, each in zip(rest[::2], rest[1::2], strict=True):
        yield each, own.get(name, NOTHING), (path, f".{name}")
    yield contents[0], NOTHING, path
