"""Records: data classes that cannot be changed, for classes that every command imports.

Reasons: docs/decisions/0116-the-start.md
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, FrozenInstanceError, dataclass, fields
from reprlib import recursive_repr
from typing import Any, NoReturn, TypeVar, cast, dataclass_transform

Kind = TypeVar("Kind", bound=type)


@dataclass_transform(frozen_default=True)
def record(kind: Kind) -> Kind:
    """Make a class what ``dataclass(frozen=True, slots=True)`` makes it, in a quarter of the time.

    That compiles six methods for each class. Here it is one, ``__init__``, and all records share the others.
    """
    made: Any = dataclass(init=False, repr=False, eq=False, slots=True)(kind)
    for name, method in {"__init__": _initialiser(made), **_SHARED}.items():
        if name not in kind.__dict__:
            setattr(made, name, method)
    return cast("Kind", made)


def is_record(kind: type) -> bool:
    """Whether a class is a record, whose objects cannot be changed."""
    setter: object = kind.__setattr__
    return setter is _set


def _initialiser(made: Any) -> Callable[..., None]:
    """Compile the method that sets the fields of a record, by the descriptors of its slots."""
    names: dict[str, Any] = {"_MISSING": MISSING}
    parameters: dict[bool, list[str]] = {False: [], True: []}
    lines = []
    for field in fields(made):
        name, default, value = field.name, "", field.name
        if field.default is not MISSING:
            names[f"_{name}_default"], default = field.default, f"=_{name}_default"
        elif field.default_factory is not MISSING:
            names[f"_{name}_factory"], default = field.default_factory, "=_MISSING"
            value = f"_{name}_factory() if {name} is _MISSING else {name}"
        names[f"_{name}_set"] = getattr(made, name).__set__
        parameters[bool(field.kw_only)].append(name + default)
        lines.append(f" _{name}_set(self, {value})")
    if hasattr(made, "__post_init__"):
        lines.append(" self.__post_init__()")
    listed = ["self", *parameters[False], *(["*", *parameters[True]] if parameters[True] else [])]
    exec(f"def __init__({', '.join(listed)}):\n" + "\n".join(lines or [" pass"]), names)
    initialiser: Callable[..., None] = names["__init__"]
    initialiser.__annotations__ = {**{field.name: field.type for field in fields(made)}, "return": None}
    initialiser.__qualname__ = f"{made.__qualname__}.__init__"
    return initialiser


def _compared(of: Any) -> tuple[Any, ...]:
    return tuple([getattr(of, field.name) for field in fields(of) if field.compare])


def _equals(self: object, other: object) -> Any:
    return _compared(self) == _compared(other) if type(other) is type(self) else NotImplemented


def _hash(self: object) -> int:
    return hash(_compared(self))


@recursive_repr("...")
def _repr(self: Any) -> str:
    shown = [f"{field.name}={getattr(self, field.name)!r}" for field in fields(self) if field.repr]
    return f"{type(self).__qualname__}({', '.join(shown)})"


def _set(self: object, name: str, value: object) -> NoReturn:
    raise FrozenInstanceError(f"cannot assign to field {name!r}")


def _delete(self: object, name: str) -> NoReturn:
    raise FrozenInstanceError(f"cannot delete field {name!r}")


def _state(self: Any) -> list[Any]:
    return [getattr(self, field.name) for field in fields(self)]


def _restore(self: Any, state: list[Any]) -> None:
    for field, value in zip(fields(self), state, strict=True):
        object.__setattr__(self, field.name, value)


_SHARED: dict[str, Any] = {
    "__eq__": _equals,
    "__hash__": _hash,
    "__repr__": _repr,
    "__setattr__": _set,
    "__delattr__": _delete,
    "__getstate__": _state,
    "__setstate__": _restore,
}
