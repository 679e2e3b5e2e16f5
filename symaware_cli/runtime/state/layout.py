"""How objects are laid out: which attributes they have, which of these hold no state, and what their classes are."""

from __future__ import annotations

import inspect
import sys
import types
from collections.abc import Mapping
from dataclasses import is_dataclass
from functools import cache
from typing import Any, NamedTuple

from symaware_cli.awareness.readonly import KnownVector
from symaware_cli.core import AwarenessVector, Scenery, Snapshot, TimeSeries, Tracks

_NO_ATTRIBUTES: Mapping[str, Any] = types.MappingProxyType({})

#: Stands for no object.
_NOTHING = object()

#: Objects of these never change; so they are made anew and not changed under the hands of who holds them.
_VALUES = (AwarenessVector, KnownVector, Scenery, Snapshot, TimeSeries, Tracks)

#: What a class may be built upon and still be made of its attributes alone.
_PLAIN = (object, tuple, list, dict, set, frozenset)


class Layout(NamedTuple):
    """What there is to know of a class.

    Attributes:
        name: Its module and its name.
        slots: The attributes that have slots.
        uncaptured: The attributes that hold no state.
        speaks: Whether its objects tell a part of their state themselves.
        is_plain: Whether its objects are made of their attributes, and of nothing that Python cannot see.
        is_data: Whether it is a data class.
        is_value: Whether its objects never change.
    """

    name: str
    slots: tuple[str, ...]
    uncaptured: frozenset[str]
    speaks: bool
    is_plain: bool
    is_data: bool
    is_value: bool

    @property
    def package(self) -> str:
        """The package that the class is in."""
        return self.name.partition(":")[0].partition(".")[0]


def layout(kind: Any) -> Layout:
    """What there is to know of a class; it is looked at once."""
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
    # What is written in another language has classes, too, whose objects have no attributes at all.
    is_plain &= bool(slots) or kind.__dictoffset__ != 0 or "__slots__" in vars(kind) or issubclass(kind, _PLAIN[1:])
    parameters = getattr(kind, "__dataclass_params__", None)
    is_frozen = is_dataclass(kind) and parameters is not None and parameters.frozen
    return Layout(
        name=named_class(kind),
        # A property of a subclass may stand in for the slot of its base.
        slots=tuple(name for name in dict.fromkeys(slots) if _is_slot(kind, name)),
        uncaptured=frozenset(uncaptured),
        speaks=callable(getattr(kind, "captured", None)),
        is_plain=is_plain,
        is_data=is_dataclass(kind),
        is_value=bool(is_frozen) or kind in _VALUES or (issubclass(kind, tuple | frozenset)),
    )


def _is_slot(kind: type, name: str) -> bool:
    return isinstance(inspect.getattr_static(kind, name, None), types.MemberDescriptorType)


def _is_private(name: str) -> bool:
    return name.startswith("__") and not name.endswith("__")


def named_class(kind: Any) -> str:
    """The module and the name of a class or a function."""
    return f"{kind.__module__}:{kind.__qualname__}"


def said_class(name: str) -> str:
    """A class as people write it."""
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
    """An attribute of an object itself, even if its class says that it has those of another object, too."""
    try:
        return object.__getattribute__(value, name)
    except AttributeError:
        return otherwise


def give(value: Any, of: Layout, found: Mapping[str, Any]) -> None:
    """Give an object the attributes that `attributes` returned of another, and take from it what that had not."""
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


def resolved(name: str) -> Any:
    """The class or the function of a name, in a module that is loaded; None where there is none.

    No module is loaded for it, and nothing is called.
    """
    module, _, qualified = name.partition(":")
    found: Any = sys.modules.get(module)
    for part in qualified.split("."):
        found = getattr(found, part, None) if isinstance(found, types.ModuleType | type) else None
    return found
