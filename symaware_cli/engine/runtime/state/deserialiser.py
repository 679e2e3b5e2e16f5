"""Restores objects from a table of entries: existing objects get their earlier state, missing ones are created."""

from __future__ import annotations

import ast
import functools
import sys
import types
from collections import OrderedDict, defaultdict, deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from symaware_cli.engine.runtime.state.counterparts import NOTHING, Counterparts
from symaware_cli.engine.runtime.state.layout import Layout, attributes, layout, resolve, set_attributes


class Deserialiser:
    """Restores serialised objects into their counterparts."""

    def __init__(self, counterparts: Counterparts) -> None:
        """Check the states of all objects with `check_state`; nothing is changed.

        Raises:
            StateError: An object cannot be restored; the message gives the reason.
        """
        self._counterparts = counterparts
        self._made: dict[int, Any] = {}
        self._to_restore: list[tuple[Any, Any]] = []
        for number, live in counterparts.found.items():
            kind, _, contents = counterparts.entries[number]
            if kind == "object" and callable(getattr(live, "check_state", None)):
                live.check_state(self._value(contents[0])[0])

    def restore(self) -> list[Any]:
        """Restore the objects of the root, and return them."""
        found = self._all(self._counterparts.roots)
        for live, state in self._to_restore:
            live.restored(state[0])
        return found

    def reseed(self, seed: int) -> None:
        """Let the restored objects that draw random numbers draw from another seed from now on."""
        for number, made in self._made.items():
            if self._counterparts.entries[number][0] == "object" and hasattr(type(made), "reseed"):
                made.reseed(seed)

    def _value(self, content: Any) -> Any:
        """The value of an atom or a reference."""
        if type(content) is not tuple:
            return content
        number = content[0]
        if number in self._made:
            return self._made[number]
        kind, name, contents = self._counterparts.entries[number]
        maker = getattr(self, f"_{kind}")
        made = maker(number, self._counterparts.found.get(number, NOTHING), name, contents)
        self._made[number] = made
        return made

    def _all(self, contents: Sequence[Any]) -> list[Any]:
        return [self._value(each) for each in contents]

    def _named(self, contents: Sequence[Any]) -> dict[str, Any]:
        return {name: self._value(each) for name, each in zip(contents[::2], contents[1::2], strict=True)}

    def _object(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        kind: Any = type(live) if live is not NOTHING else resolve(name)
        of = layout(kind)
        rest = contents[2:]
        if of.is_value and not of.captures_itself:
            found = self._named(rest)
            if live is not NOTHING and _are_same(attributes(live, of), found):
                return live
            made = object.__new__(kind)
            set_attributes(made, of, found)
            return made
        made = object.__new__(kind) if live is NOTHING else live
        self._made[number] = made
        set_attributes(made, of, self._named(rest))
        if of.captures_itself:
            self._to_restore.append((made, self._value(contents[0])))
        return made

    def _finish(self, made: Any, of: Layout, rest: list[Any]) -> Any:
        if rest or getattr(made, "__dict__", None):
            set_attributes(made, of, self._named(rest))
        return made

    def _list(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        kind: Any = type(live) if live is not NOTHING else resolve(name)
        made = kind.__new__(kind) if live is NOTHING else live
        self._made[number] = made
        count = contents[1]
        list.__setitem__(made, slice(None), self._all(contents[2 : 2 + count]))
        return self._finish(made, layout(kind), contents[2 + count :])

    def _deque(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        count = contents[1]
        made = deque(maxlen=contents[2 + count]) if live is NOTHING else live
        self._made[number] = made
        held = self._all(contents[2 : 2 + count])
        made.clear()
        made.extend(held)
        return made

    def _tuple(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        kind: Any = type(live) if live is not NOTHING else resolve(name)
        count = contents[1]
        held, rest = self._all(contents[2 : 2 + count]), self._named(contents[2 + count :])
        if (
            live is not NOTHING
            and len(live) == len(held)
            and all(map(_is_same, live, held))
            and (not rest or _are_same(attributes(live, layout(kind)), rest))
        ):
            return live
        made = tuple.__new__(kind, held)
        if rest:
            set_attributes(made, layout(kind), rest)
        return made

    def _dict(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        kind: Any = type(live) if live is not NOTHING else resolve(name)
        of = layout(kind)
        count = contents[1]
        held, rest = contents[2 : 2 + count], contents[2 + count :]
        if live is NOTHING:
            made = defaultdict(self._value(rest[0])) if kind is defaultdict else kind.__new__(kind)
        else:
            made = live
        self._made[number] = made
        found = [(self._value(key), self._value(each)) for key, each in zip(held[::2], held[1::2], strict=True)]
        dict.clear(made)
        if isinstance(made, OrderedDict):
            OrderedDict.clear(made)
        for key, each in found:
            (OrderedDict if isinstance(made, OrderedDict) else dict).__setitem__(made, key, each)
        return made if kind is defaultdict else self._finish(made, of, rest)

    def _set(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        kind: Any = type(live) if live is not NOTHING else resolve(name)
        made = kind.__new__(kind) if live is NOTHING else live
        self._made[number] = made
        count = contents[1]
        held = self._all(contents[2 : 2 + count])
        set.clear(made)
        set.update(made, held)
        return self._finish(made, layout(kind), contents[2 + count :])

    def _frozenset(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        kind: Any = type(live) if live is not NOTHING else resolve(name)
        count = contents[1]
        held = self._all(contents[2 : 2 + count])
        if live is not NOTHING and frozenset.__eq__(live, frozenset(held)) is True:
            return live
        return self._finish(frozenset.__new__(kind, held), layout(kind), contents[2 + count :])

    def _array(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        data, dtype, shape, order, writeable, *extra = contents
        found = np.frombuffer(data, _dtype(dtype)).reshape(_numbers(shape))
        if order:
            found = found.transpose(np.argsort(_numbers(order)))
        if live is not NOTHING and live.shape == found.shape and live.dtype == found.dtype:
            alike = live.strides == found.strides
            if writeable and live.flags.writeable and live.base is None and alike:
                np.copyto(live, found)
                return live
            if (
                not writeable
                and not live.flags.writeable
                and alike
                and _bytes(live) == _bytes(found)
                and (not extra or live.known_as == extra[0])
            ):
                return live
        made = found.copy(order="K")
        kind = np.ndarray if name == "numpy:ndarray" else resolve(name)
        return self._dressed(made, kind, writeable, extra)

    @staticmethod
    def _dressed(made: Any, kind: Any, writeable: bool, extra: Sequence[Any]) -> Any:
        if kind is not np.ndarray:
            if not writeable:
                made.flags.writeable = False
            made = made.view(kind)
            if extra:
                made.known_as = extra[0]
        made.flags.writeable = writeable
        return made

    def _view(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        owner, dtype, offset, shape, strides, writeable, *extra = contents
        base = self._value(owner)
        if live is not NOTHING and live.base is base and not extra:
            same = live.dtype == _dtype(dtype) and live.shape == _numbers(shape) and live.strides == _numbers(strides)
            first = live.__array_interface__["data"][0] - base.__array_interface__["data"][0]
            if same and first == offset and live.flags.writeable == writeable:
                return live
        was = base.flags.writeable
        if writeable and not was:
            base.flags.writeable = True
        flat = (
            base.transpose(np.argsort([-abs(each) for each in base.strides], kind="stable")) if base.ndim > 1 else base
        )
        made: Any = np.ndarray(_numbers(shape), _dtype(dtype), flat, offset, _numbers(strides))
        base.flags.writeable = was
        return self._dressed(made, resolve(name), writeable, extra)

    def _objects(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        shape, writeable, *held = contents
        values = self._all(held)
        fixed = live is not NOTHING and not writeable and not live.flags.writeable
        if fixed and live.shape == _numbers(shape) and all(map(_is_same, live.ravel().tolist(), values)):
            return live
        made = np.empty(len(values), object)
        made[:] = values
        made = made.reshape(_numbers(shape)) if len(_numbers(shape)) != 1 else made
        return self._dressed(made, resolve(name), writeable, ())

    def _method(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        owner = self._value(contents[0])
        if live is not NOTHING and live.__self__ is owner:
            return live
        return types.MethodType(getattr(type(owner), name), owner)

    def _builtin(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        owner = self._value(contents[0])
        return live if live is not NOTHING and live.__self__ is owner else getattr(owner, name)

    def _function(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        found = resolve(name) if live is NOTHING else live
        self._made[number] = found
        self._all(contents)
        return found

    def _cell(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        made = types.CellType() if live is NOTHING else live
        self._made[number] = made
        for each in contents:
            made.cell_contents = self._value(each)
        return made

    def _partial(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        func, args, keywords = self._all(contents)
        if live is not NOTHING and live.func is func and live.args is args and live.keywords == keywords:
            return live
        return functools.partial(func, *args, **keywords)

    def _fixed(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        if live is not NOTHING:
            return live
        if name.endswith(":"):
            return sys.modules[name[:-1]]
        return resolve(name)

    def _same(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        return live

    def _known(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        return live

    def _enum(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        return resolve(name)[contents[0]]

    def _generator(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        made = np.random.Generator(getattr(np.random, name)()) if live is NOTHING else live
        made.bit_generator.state = self._value(contents[0])
        return made

    def _int(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        return int(name)

    def _complex(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        return complex(*contents)

    def _dtype(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        return np.dtype(name)

    def _range(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        return range(*self._all(contents))

    def _slice(self, number: int, live: Any, name: str, contents: list[Any]) -> Any:
        return slice(*self._all(contents))


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(map(int, text.split(","))) if text else ()


def _dtype(told: str) -> np.dtype[Any]:
    if not told.startswith("["):
        return np.dtype(told)
    fields = [tuple(each) for each in ast.literal_eval(told)]
    return np.dtype(fields)


def _bytes(array: Any) -> bytes:
    data: bytes = array.tobytes()
    return data


def _is_same(one: Any, other: Any) -> bool:
    """Whether two values are the same object, or atoms of the same type and value."""
    if one is other:
        return True
    kind = type(one)
    return kind is type(other) and kind in (int, float, str, bytes, bool, complex) and repr(one) == repr(other)


def _are_same(ones: Mapping[str, Any], others: Mapping[str, Any]) -> bool:
    return ones.keys() == others.keys() and all(_is_same(each, others[name]) for name, each in ones.items())
