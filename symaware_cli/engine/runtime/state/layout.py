"""The layout of classes: slots and attributes that hold state, and whether objects can be captured by attributes."""

from __future__ import annotations

import inspect
import sys
import types
from collections.abc import Mapping
from dataclasses import is_dataclass
from functools import cache
from typing import Any, NamedTuple

from pydantic import BaseModel

from symaware_cli.awareness import KnownVector
from symaware_cli.core import AwarenessVector, Scenery, Snapshot, TimeSeries, Tracks
from symaware_cli.world import is_record

_NO_ATTRIBUTES: Mapping[str, Any] = types.MappingProxyType({})

#: Stands for no object.
_NOTHING = object()

#: Classes of immutable objects: they are created again instead of being changed in place.
_VALUES = (AwarenessVector, KnownVector, Scenery, Snapshot, TimeSeries, Tracks)

#: Built-in base classes with which objects can still be captured by their attributes.
_PLAIN = (object, tuple, list, dict, set, frozenset)


class Layout(NamedTuple):
    """The properties of a class that matter for capturing its objects.

    Attributes:
        name: Its module and its qualified name.
        slots: The attributes with slots.
        uncaptured: The attributes without state.
        captures_itself: Whether it has the method `captured`.
        is_plain: Whether attributes visible to Python are all the state of its objects.
        is_data: Whether it is a data class.
        is_value: Whether its objects are immutable.
        is_model: Whether its objects are immutable models of pydantic, such as parameters, whose
            contents are not changed either.
    """

    name: str
    slots: tuple[str, ...]
    uncaptured: frozenset[str]
    captures_itself: bool
    is_plain: bool
    is_data: bool
    is_value: bool
    is_model: bool

    @property
    def package(self) -> str:
        """The top-level package of the class."""
        return self.name.partition(":")[0].partition(".")[0]


def layout(kind: Any) -> Layout:
    """The layout of a class; computed once for each class."""
    return _layout(kind)


@cache
def _layout(kind: Any) -> Layout:
    slots: list[str] = []
    uncaptured: set[str] = set()
    is_plain = True
    for base in kind.__mro__:
        own = vars(base)
        uncaptured.update(own.get("uncaptured", ()))
        named = own.get("__slots__", ())
        slots += [
            f"_{base.__name__.lstrip('_')}{name}" if _is_private(name) else name
            for name in ((named,) if isinstance(named, str) else named)
            if name not in ("__dict__", "__weakref__")
        ]
        is_heap = bool(base.__flags__ & (1 << 9))
        is_plain &= base in _PLAIN or (is_heap and ("__slots__" in own or "__dict__" in own or "__module__" in own))
    # Classes of extension modules may have objects without any attributes.
    is_plain &= bool(slots) or kind.__dictoffset__ != 0 or "__slots__" in vars(kind) or issubclass(kind, _PLAIN[1:])
    parameters = getattr(kind, "__dataclass_params__", None)
    is_frozen = is_record(kind) or (is_dataclass(kind) and parameters is not None and parameters.frozen)
    is_model = issubclass(kind, BaseModel) and bool(kind.model_config.get("frozen"))
    return Layout(
        name=qualified_name(kind),
        # A property of a subclass may stand in for the slot of its base.
        slots=tuple(name for name in dict.fromkeys(slots) if _is_slot(kind, name)),
        uncaptured=frozenset(uncaptured),
        captures_itself=callable(getattr(kind, "captured", None)),
        is_plain=is_plain,
        is_data=is_dataclass(kind),
        is_value=bool(is_frozen) or is_model or kind in _VALUES or (issubclass(kind, tuple | frozenset)),
        is_model=is_model,
    )


def _is_slot(kind: type, name: str) -> bool:
    return isinstance(inspect.getattr_static(kind, name, None), types.MemberDescriptorType)


def _is_private(name: str) -> bool:
    return name.startswith("__") and not name.endswith("__")


def qualified_name(kind: Any) -> str:
    """The module and the name of a class or a function."""
    return f"{kind.__module__}:{kind.__qualname__}"


def format_class(name: str) -> str:
    """Format the name of a class for a message."""
    module, _, qualified = name.partition(":")
    return qualified if module in ("builtins", "") else f"{module}.{qualified}"


def attributes(value: Any, of: Layout) -> dict[str, Any]:
    """The attributes of an object that hold state, by name."""
    if "*" in of.uncaptured:
        return {}
    own = _own(value, "__dict__", _NO_ATTRIBUTES)
    found = {name: each for name, each in own.items() if name not in of.uncaptured}
    for name in of.slots:
        if name not in of.uncaptured:
            each = _own(value, name, _NOTHING)
            if each is not _NOTHING:
                found[name] = each
    return found


def _own(value: Any, name: str, otherwise: Any) -> Any:
    """An attribute of an object itself, bypassing `__getattribute__` and `__getattr__` of its class."""
    try:
        return object.__getattribute__(value, name)
    except AttributeError:
        return otherwise


def set_attributes(value: Any, of: Layout, found: Mapping[str, Any]) -> None:
    """Set the attributes returned by `attributes` for another object, and delete all others that hold state."""
    if "*" in of.uncaptured:
        return
    own = _own(value, "__dict__", None)
    if own is not None:
        for name in [name for name in own if name not in found and name not in of.uncaptured]:
            del own[name]
        own.update({name: each for name, each in found.items() if name not in of.slots})
    for name in of.slots:
        if name in of.uncaptured:
            continue
        if name in found:
            object.__setattr__(value, name, found[name])
        elif _own(value, name, _NOTHING) is not _NOTHING:
            object.__delattr__(value, name)


def resolve(name: str) -> Any:
    """Return the class or function with a qualified name in a loaded module; None if there is none.

    No module is imported, and no code is called.
    """
    module, _, qualified = name.partition(":")
    found: Any = sys.modules.get(module)
    for part in qualified.split("."):
        found = getattr(found, part, None) if isinstance(found, types.ModuleType | type) else None
    return found
