"""Serialises a graph of objects into a table of entries that hold only plain values.

An entry is a tuple of its kind, a name (mostly of a class), and a list of contents. A content is an atom (None, a truth
value, a number, a text, bytes) or a reference: a tuple with the number of another entry. So cyclic references are
possible, and the identity of objects is kept.
"""

from __future__ import annotations

import enum
import types
from collections import defaultdict, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import cache, partial
from pathlib import PurePath
from typing import Any

import numpy as np

from symaware_cli.core.stateful import StateError
from symaware_cli.engine.runtime.state.layout import Layout, attributes, format_class, layout, qualified_name

Entry = tuple[str, str, list[Any]]

#: The path of an object: a linked list of names, the last one first.
Path = tuple[Any, str]

_ATOMS = frozenset({type(None), bool, float, str, bytes})

_NOBODY: Mapping[int, str] = types.MappingProxyType({})

_HELP = (
    "if it holds no state, name the attribute in `uncaptured` of its class; otherwise implement `captured` and "
    "`restored` in its class"
)


def format_path(path: Path | None) -> str:
    """Format the path of an object for a message."""
    names: list[str] = []
    while path is not None:
        names.append(path[1])
        path = path[0]
    return "".join(reversed(names))


class Serialiser:
    """Serialises objects and everything that they refer to.

    Attributes:
        entries: The table; the first entry is the root.
    """

    def __init__(self, root: Mapping[str, Any], packages: Collection[str], known: Mapping[int, str] = _NOBODY) -> None:
        """Serialise objects.

        Args:
            root: The objects, by the names used in messages.
            packages: The packages whose classes are captured by their attributes, besides data classes; objects of
                other classes may have state that is not in attributes.
            known: The names, by identity, of objects that exist at the destination as well, and are serialised only if
                they are in the root.

        Raises:
            StateError: An object cannot be captured; the message gives its path.
        """
        self.entries: list[Entry] = []
        self._packages = packages
        self._numbers: dict[int, int] = {}
        self._kept: list[Any] = []  # so that identities are not reused
        contents: list[Any] = []
        self.entries.append(("root", "", contents))
        self._waiting: deque[Callable[[], None]] = deque()
        self._known = _NOBODY
        for name, value in root.items():
            contents += [name, self._put(value, (None, name))]
        self._known = known
        while self._waiting:
            # Breadth first, so that each object is named by its shortest path.
            self._waiting.popleft()()

    def objects(self) -> Iterator[tuple[Entry, Any]]:
        """Yield each entry but the first with the object that it was made of."""
        return zip(self.entries[1:], self._kept, strict=True)

    def _put(self, value: Any, path: Path) -> Any:
        kind: Any = type(value)
        if kind in _ATOMS:
            return value
        if kind is int:
            return value if -(2**63) <= value < 2**63 else self._new(value, "int", str(value), [])
        number = self._numbers.get(id(value))
        if number is not None:
            return (number,)
        name = self._known.get(id(value))
        if name is not None:
            return self._new(value, "known", name, [])
        return _serialise_function(kind)(self, value, path)

    def _refuse(self, path: Path, why: str) -> None:
        raise StateError(f"the state of {format_path(path)} cannot be captured: it {why}; {_HELP}")

    def _new(self, value: Any, kind: str, name: str, contents: list[Any]) -> tuple[int]:
        number = len(self.entries)
        self._numbers[id(value)] = number
        self._kept.append(value)
        self.entries.append((kind, name, contents))
        return (number,)

    def _later(self, value: Any, kind: str, name: str, fill: Callable[[], Iterable[Any]], *contents: Any) -> tuple[int]:
        """Add an entry whose remaining contents are filled in later."""
        everything = [*contents]
        reference = self._new(value, kind, name, everything)
        self._waiting.append(lambda: everything.extend(fill()))
        return reference

    def _attributes(self, value: Any, of: Layout, path: Path) -> list[Any]:
        found: list[Any] = []
        for name, each in sorted(attributes(value, of).items()):
            found += [name, self._put(each, (path, f".{name}"))]
        return found

    def _number(self, value: Any, path: Path) -> Any:
        if value.dtype.kind not in "biuf":
            self._refuse(path, f"is a {format_class(qualified_name(type(value)))}")
        return value

    def _object(self, value: Any, path: Path) -> tuple[int]:
        of = layout(type(value))
        if not (of.captures_itself or (of.is_plain and (of.is_data or of.package in self._packages))):
            self._refuse(path, f"is a {format_class(of.name)}")

        def fill() -> list[Any]:
            if not of.captures_itself:
                return [None, 0, *self._attributes(value, of, path)]
            try:
                part = value.captured()
            except StateError as error:
                raise StateError(f"the state of {format_path(path)} cannot be captured: {error}") from error
            return [self._put([part], (path, ".captured()")), 0, *self._attributes(value, of, path)]

        return self._later(value, "object", of.name, fill)

    def _sequence(self, value: Any, path: Path) -> tuple[int]:
        kind = next(each for each in (list, tuple, deque) if isinstance(value, each))
        return self._collection(value, kind, path, lambda: self._all(value, path))

    def _set(self, value: Any, path: Path) -> tuple[int]:
        kind = frozenset if isinstance(value, frozenset) else set
        try:
            ordered = sorted(value)
        except TypeError:
            ordered = list(value)
        return self._collection(value, kind, path, lambda: self._all(ordered, path))

    def _mapping(self, value: Any, path: Path) -> tuple[int]:
        def contents() -> list[Any]:
            found: list[Any] = []
            for key, each in value.items():
                place = (path, f"[{key!r}]" if type(key) in (str, int, tuple) else "[...]")
                found += [self._put(key, place), self._put(each, place)]
            return found

        return self._collection(value, dict, path, contents)

    def _all(self, values: Iterable[Any], path: Path) -> list[Any]:
        return [self._put(each, (path, f"[{number}]")) for number, each in enumerate(values)]

    def _collection(self, value: Any, kind: type, path: Path, contents: Callable[[], list[Any]]) -> tuple[int]:
        of = layout(type(value))

        def fill() -> list[Any]:
            held = contents()
            found = [None, len(held), *held]
            if kind is deque:
                return [*found, value.maxlen]
            if isinstance(value, defaultdict):
                return [*found, self._put(value.default_factory, (path, ".default_factory"))]
            return found + self._attributes(value, of, path)

        return self._later(value, kind.__name__, of.name, fill)

    def _array(self, value: Any, path: Path) -> tuple[int]:
        own, dtype = layout(type(value)).name, value.dtype
        if isinstance(value, np.memmap) or (dtype.kind != "O" and dtype.hasobject) or dtype.kind == "m":
            self._refuse(path, f"is an array of {dtype}" + (" in a file" if isinstance(value, np.memmap) else ""))
        extra = [value.known_as] if hasattr(value, "known_as") else []
        writeable, base = bool(value.flags.writeable), value.base
        if dtype.kind == "O":
            fill = partial(self._all, value.ravel().tolist(), path)
            return self._later(value, "objects", own, fill, _joined(value.shape), writeable)
        told = repr(dtype.descr) if dtype.names else dtype.str
        if type(base) is np.ndarray and base.dtype.kind != "O" and value.size:
            offset = value.__array_interface__["data"][0] - base.__array_interface__["data"][0]
            contents = [told, offset, _joined(value.shape), _joined(value.strides), writeable, *extra]
            return self._new(value, "view", own, [self._put(base, path), *contents])
        # The layout in memory is kept, because the last bits of results may depend on it.
        dense, axes = value, ""
        if not value.flags.c_contiguous:
            order = sorted(range(value.ndim), key=lambda axis: -abs(value.strides[axis]))
            dense, axes = np.ascontiguousarray(value.transpose(order).view(np.ndarray)), _joined(order)
        contents = [dense.tobytes(), told, _joined(dense.shape), axes, writeable, *extra]
        return self._new(value, "array", own, contents)

    def _method(self, value: Any, path: Path) -> tuple[int]:
        return self._new(value, "method", value.__func__.__name__, [self._put(value.__self__, (path, ".__self__"))])

    def _builtin(self, value: Any, path: Path) -> tuple[int]:
        owner = value.__self__
        if owner is None or isinstance(owner, types.ModuleType):
            return self._new(value, "fixed", qualified_name(value), [])
        return self._new(value, "builtin", value.__name__, [self._put(owner, (path, ".__self__"))])

    def _function(self, value: Any, path: Path) -> tuple[int]:
        cells = [
            self._put(cell, (path, f".{name}"))
            for name, cell in zip(value.__code__.co_freevars, value.__closure__ or (), strict=True)
        ]
        return self._new(value, "function", qualified_name(value), cells)

    def _cell(self, value: Any, path: Path) -> tuple[int]:
        def fill() -> list[Any]:
            try:
                return [self._put(value.cell_contents, path)]
            except ValueError:
                return []

        return self._later(value, "cell", "", fill)

    def _partial(self, value: Any, path: Path) -> tuple[int]:
        names = ("func", "args", "keywords")
        fill = partial(map, lambda name: self._put(getattr(value, name), (path, f".{name}")), names)
        return self._later(value, "partial", "", fill)

    def _fixed(self, value: Any, path: Path) -> tuple[int]:
        name = value.__name__ + ":" if isinstance(value, types.ModuleType) else qualified_name(value)
        return self._new(value, "fixed", name, [])

    def _enumeration(self, value: Any, path: Path) -> tuple[int]:
        return self._new(value, "enum", qualified_name(type(value)), [value.name])

    def _same(self, value: Any, path: Path) -> tuple[int]:
        return self._new(value, "same", qualified_name(type(value)), [])

    def _generator(self, value: Any, path: Path) -> tuple[int]:
        kind = type(value.bit_generator).__name__
        return self._new(value, "generator", kind, [self._put(value.bit_generator.state, path)])

    def _range(self, value: Any, path: Path) -> tuple[int]:
        return self._new(value, type(value).__name__, "", self._all((value.start, value.stop, value.step), path))

    def _complex(self, value: complex, path: Path) -> tuple[int]:
        return self._new(value, "complex", "", [value.real, value.imag])

    def _dtype(self, value: Any, path: Path) -> tuple[int]:
        return self._new(value, "dtype", value.str, [])

    def _running(self, value: Any, path: Path) -> None:
        what = "coroutine" if isinstance(value, types.CoroutineType) else "generator"
        self._refuse(path, f"is a suspended {what}, `{value.__qualname__}`")


def _joined(numbers: Iterable[int]) -> str:
    """Join numbers into one atom."""
    return ",".join(map(str, numbers))


SerialiseFunction = Callable[[Serialiser, Any, Path], Any]

#: The functions that serialise instances of each type, special types first; all others are captured by attributes.
_SERIALISERS: tuple[tuple[Any, SerialiseFunction], ...] = (
    (np.ndarray, Serialiser._array),
    (enum.Enum, Serialiser._enumeration),
    (np.dtype, Serialiser._dtype),
    (list | tuple | deque, Serialiser._sequence),
    (dict, Serialiser._mapping),
    (set | frozenset, Serialiser._set),
    (types.MethodType, Serialiser._method),
    (types.BuiltinFunctionType, Serialiser._builtin),
    (types.FunctionType, Serialiser._function),
    (types.CellType, Serialiser._cell),
    (partial, Serialiser._partial),
    (type | types.ModuleType | np.ufunc | type(np.min), Serialiser._fixed),
    (np.random.Generator, Serialiser._generator),
    (range | slice, Serialiser._range),
    (complex, Serialiser._complex),
    (types.CoroutineType | types.GeneratorType, Serialiser._running),
    (PurePath, Serialiser._same),
    (np.generic, Serialiser._number),
)


@cache
def _serialise_function(kind: Any) -> SerialiseFunction:
    return next((take for known, take in _SERIALISERS if issubclass(kind, known)), Serialiser._object)
