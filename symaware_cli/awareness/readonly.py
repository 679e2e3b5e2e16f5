"""Deeply read-only values for entries of knowledge, which can be changed only by assigning the entry."""

from __future__ import annotations

from collections.abc import Callable, Mapping, MutableSequence
from collections.abc import Set as AbstractSet
from copy import deepcopy
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness.awareness import AwarenessVector

#: The greatest depth of nested lists and mappings.
_DEPTH = 100


def _refuse(value: Any, *_: Any, **__: Any) -> NoReturn:
    name = getattr(value, "known_as", "")
    raise TypeError(
        f"knowledge cannot be changed in place, because the change would not be noticed: change a copy and assign "
        f'that, self_knowledge["{name or "..."}"] = ...'
    )


class KnownList(tuple[Any, ...]):
    """A list that cannot be changed; it equals a list or a tuple of the same elements.

    Attributes:
        known_as: The name of the knowledge that it is or belongs to.
    """

    known_as: str

    def __eq__(self, other: object) -> bool:
        return tuple.__eq__(self, tuple(other) if isinstance(other, list) else other)

    def __ne__(self, other: object) -> bool:
        return not self == other

    __hash__ = tuple.__hash__

    def __add__(self, other: Any) -> Any:
        return [*self, *other]

    def __radd__(self, other: Any) -> Any:
        return [*other, *self]

    def __reduce__(self) -> Any:
        return readonly, (list(self), self.known_as)

    def __deepcopy__(self, memo: dict[int, Any]) -> list[Any]:
        return [deepcopy(each, memo) for each in self]

    append = extend = insert = remove = pop = clear = sort = reverse = _refuse
    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refuse


class KnownMapping(dict[Any, Any]):
    """A mapping that cannot be changed.

    Attributes:
        known_as: The name of the knowledge that it is or belongs to.
    """

    known_as: str

    def __reduce__(self) -> Any:
        return readonly, (dict(self), self.known_as)

    def __deepcopy__(self, memo: dict[int, Any]) -> dict[Any, Any]:
        return {name: deepcopy(each, memo) for name, each in self.items()}

    __setitem__ = __delitem__ = __ior__ = _refuse
    update = setdefault = pop = popitem = clear = _refuse


class KnownSet(frozenset[Any]):
    """A set that cannot be changed.

    Attributes:
        known_as: The name of the knowledge that it is or belongs to.
    """

    known_as: str

    def __reduce__(self) -> Any:
        return readonly, (set(self), self.known_as)

    def __deepcopy__(self, memo: dict[int, Any]) -> set[Any]:
        return set(self)

    add = discard = remove = pop = clear = update = _refuse
    difference_update = intersection_update = symmetric_difference_update = _refuse
    __iand__ = __ior__ = __isub__ = __ixor__ = _refuse


def _if_own(name: str) -> Callable[..., Any]:
    """Return a method that may change arrays derived from a known one, such as a product, but not that one."""

    def change(array: KnownArray, *arguments: Any, **named: Any) -> Any:
        if not array.flags.writeable:
            _refuse(array)
        return getattr(np.ndarray, name)(array, *arguments, **named)

    return change


class KnownArray(np.ndarray[Any, Any]):
    """An array that cannot be changed; results of computations with it are plain arrays.

    Attributes:
        known_as: The name of the knowledge that it is or belongs to.
    """

    known_as: str = ""

    def __array_finalize__(self, parent: Any) -> None:
        self.known_as = getattr(parent, "known_as", "")

    def __setattr__(self, name: str, value: Any) -> None:
        if name != "known_as" and not self.flags.writeable:
            _refuse(self)
        super().__setattr__(name, value)

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        return array if array.ndim else array[()]

    def __reduce__(self) -> Any:
        return _array, (np.array(self), self.known_as)

    def __deepcopy__(self, memo: dict[int, Any] | None) -> Any:
        return deepcopy(np.array(self), memo)

    def copy(self, order: Any = "C") -> Any:
        """A plain array of the same elements, to change and assign."""
        return np.array(self, order=order)

    __setitem__ = _if_own("__setitem__")
    fill, sort, partition, put = map(_if_own, ("fill", "sort", "partition", "put"))
    __iadd__, __isub__, __imul__, __imatmul__ = map(_if_own, ("__iadd__", "__isub__", "__imul__", "__imatmul__"))
    __itruediv__, __ifloordiv__, __imod__ = map(_if_own, ("__itruediv__", "__ifloordiv__", "__imod__"))
    __ipow__, __iand__, __ior__, __ixor__ = map(_if_own, ("__ipow__", "__iand__", "__ior__", "__ixor__"))


class KnownVector(AwarenessVector):
    """An awareness vector that cannot be changed."""

    __slots__ = ("known_as",)

    known_as: str

    def __setattr__(self, name: str, value: Any) -> None:
        _refuse(self)

    def __setitem__(self, name: str, value: Any) -> None:
        _refuse(self)

    def __reduce__(self) -> Any:
        return readonly, (self.__deepcopy__({}), self.known_as)

    def __deepcopy__(self, memo: dict[int, Any]) -> AwarenessVector:
        return self.replaced()


def readonly(value: Any, name: str) -> Any:
    """Return a read-only value that is independent of the original.

    Lists, tuples and other mutable sequences become tuples; mappings, arrays, sets and awareness vectors become
    read-only ones; texts, numbers and time series are immutable already. Objects of other classes are returned
    unchanged.

    Args:
        value: The value.
        name: The name of the entry, for the error message of an attempt to change it.

    Raises:
        ValueError: The value contains itself, or is nested too deep.
    """
    return _readonly(value, name, ())


def _readonly(value: Any, name: str, outer: tuple[int, ...]) -> Any:
    kind = type(value)
    if kind in (float, int, str, bool, type(None)):
        return value
    if kind in (KnownList, KnownMapping, KnownSet, KnownVector) and value.known_as == name:
        return value
    if isinstance(value, np.ndarray):
        if (
            isinstance(value, KnownArray)
            and value.known_as == name
            and not value.flags.writeable
            and value.dtype != object
        ):
            return value
        if value.dtype != object:
            return _array(np.array(value), name)
    elif isinstance(value, AwarenessVector):
        return _vector(value, name)
    elif isinstance(value, bytearray | memoryview):
        return bytes(value)
    elif not isinstance(value, tuple | MutableSequence | Mapping | AbstractSet):
        return value
    if id(value) in outer:
        raise ValueError(f"the knowledge `{name}` contains itself")
    if len(outer) == _DEPTH:
        raise ValueError(f"the knowledge `{name}` is nested more than {_DEPTH} levels deep")
    inner = (*outer, id(value))
    made: Any
    if isinstance(value, Mapping):
        made = KnownMapping({key: _readonly(each, name, inner) for key, each in value.items()})
    elif isinstance(value, AbstractSet):
        made = KnownSet(value)
    elif isinstance(value, np.ndarray):
        elements = np.empty(value.shape, object)
        for place, each in enumerate(value.flat):
            elements.flat[place] = _readonly(each, name, inner)
        return _array(elements, name)
    else:
        parts = [_readonly(each, name, inner) for each in value]
        if hasattr(kind, "_make"):  # a named tuple, which cannot be changed anyway
            return kind._make(parts)
        made = KnownList(parts)
    made.known_as = name
    return made


def _array(values: NDArray[Any], name: str) -> KnownArray:
    values.flags.writeable = False
    array: KnownArray = values.view(KnownArray)
    array.known_as = name
    return array


def _vector(vector: AwarenessVector, name: str) -> KnownVector:
    made = KnownVector.__new__(KnownVector)
    plain = vector.replaced()
    for attribute in AwarenessVector.__slots__:
        object.__setattr__(made, attribute, getattr(plain, attribute))
    object.__setattr__(made, "known_as", name)
    return made
