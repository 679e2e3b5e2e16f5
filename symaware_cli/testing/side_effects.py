"""Side effects of a plugin's methods: changes of values, draws from global generators, and reads of the clock."""

from __future__ import annotations

import datetime
import functools
import hashlib
import random
import sys
import time
from collections.abc import Collection, Iterator, Mapping, Set
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from types import BuiltinFunctionType, FrameType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from symaware_cli.core import Agent, AgentGroup, EventBus, Plugin, Surroundings
from symaware_cli.engine import ComponentEntry
from symaware_cli.testing.conformance import DeviationList, is_code_of, modules_of

#: Functions of the module `time` that differ from run to run.
_CLOCKS = (
    *("time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns"),
    *("process_time", "process_time_ns"),
)

#: Objects that are checked elsewhere, or hold no state of the plugin.
_APART = (
    *(Agent, AgentGroup, ComponentEntry, EventBus, Plugin, Surroundings),
    *(ModuleType, FunctionType, BuiltinFunctionType, type, Enum),
)

#: Attributes that the package keeps in plugins.
_OURS = frozenset(
    {"parameters", "name", "path", "use", "period", "_agent", "_group", "_surroundings"}
    | {"_random", "_turn_begun", "_computed_at", "_triggered"}
    | {"_bounds", "_unbounded", "_position_columns"}
)

_DEEPEST = 12


def fingerprint(value: Any) -> str:
    """Return a digest of a value: equal for equal numbers, texts, arrays, and objects of these."""
    digest = hashlib.blake2b(digest_size=16)
    _add(digest, value, {}, 0)
    return digest.hexdigest()


def _add(digest: Any, value: Any, seen: dict[int, int], depth: int) -> None:
    kind = type(value)
    digest.update(f"{kind.__name__}:".encode())
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        digest.update(repr(value).encode())
        return
    if isinstance(value, np.ndarray | np.generic):
        array = np.asarray(value)
        digest.update(f"{array.dtype}{array.shape}".encode())
        if array.dtype != object:
            digest.update(array.tobytes())
            return
        value = array.tolist()
    if isinstance(value, _APART) or depth > _DEEPEST:
        return
    if id(value) in seen:
        digest.update(str(seen[id(value)]).encode())
        return
    seen[id(value)] = len(seen)
    if isinstance(value, MethodType):
        digest.update(value.__name__.encode())
    elif isinstance(value, Mapping):
        for key, each in value.items():
            _add(digest, key, seen, depth + 1)
            _add(digest, each, seen, depth + 1)
    elif isinstance(value, Set):
        digest.update("".join(sorted(fingerprint(each) for each in value)).encode())
    elif isinstance(value, Collection):
        for each in value:
            _add(digest, each, seen, depth + 1)
    else:
        for name, each in sorted(_attributes(value).items()):
            digest.update(name.encode())
            _add(digest, each, seen, depth + 1)


def _attributes(value: Any) -> dict[str, Any]:
    """Return the attributes of an object, without those that are computed once on demand."""
    kind = type(value)
    names = [name for each in kind.__mro__ for name in _slots(each)]
    return {
        name: getattr(value, name)
        for name in (*names, *getattr(value, "__dict__", ()))
        if hasattr(value, name) and not isinstance(getattr(kind, name, None), functools.cached_property)
    }


def _slots(kind: type) -> Collection[str]:
    slots = vars(kind).get("__slots__", ())
    return [slots] if isinstance(slots, str) else list(slots)


def own_state(plugin: Any) -> dict[str, str]:
    """Return a fingerprint of each attribute of a plugin, except those that it declares to have no state.

    These are the names in ``uncaptured`` (see `symaware_cli.core.stateful.Stateful`) and cached properties.
    """
    kind = type(plugin)
    without = {*_OURS, *getattr(kind, "uncaptured", ())}
    return {
        f"self.{name}": fingerprint(value)
        for name, value in vars(plugin).items()
        if name not in without and not isinstance(getattr(kind, name, None), functools.cached_property)
    }


def group_state(group: AgentGroup) -> dict[str, str]:
    """Return a fingerprint of the awareness, the knowledge and the control inputs of a group, by their names."""
    awareness = group.awareness
    found = {f"the {name}": fingerprint(_column(column)) for name, column in awareness.columns.items()}
    found["the control input"] = fingerprint(group.control_column.values)
    found["the knowledge"] = fingerprint([dict(each) for each in group.knowledge])
    found["beliefs about others"] = fingerprint([_motions(awareness.seen), _motions(awareness.received)])
    return found


def _column(column: Any) -> Any:
    rows = getattr(column, "row", None)
    if hasattr(column, "values"):
        return column.values
    if hasattr(column, "tables"):
        return column.tables
    return [rows(index) for index in range(len(column))] if rows and hasattr(column, "__len__") else column.held()


def _motions(tracks: Any) -> Any:
    if tracks is None:
        return None
    return [tracks.time, tracks.pointers, tracks.others, tracks.positions, tracks.velocities, tracks.covariances]


#: A seed that no plugin is likely to choose.
_UNLIKELY = 2_862_933_555


@contextmanager
def watched(found: DeviationList, where: str) -> Iterator[None]:
    """Find draws from global generators and reads of the clock within the block.

    The clock functions are replaced while the block is executed, in their modules and where the plugin's modules
    imported them. The states of the global generators are restored.

    Args:
        found: Receives the deviations.
        where: The method that the block calls.
    """
    numpy_kept, python_kept = np.random.get_state(), random.getstate()  # noqa: NPY002 # the generator that is watched
    # States that no plugin sets, so that a plugin that seeds the generators is found as well.
    np.random.seed(_UNLIKELY)  # noqa: NPY002
    random.seed(_UNLIKELY)
    numpy_before, python_before = np.random.get_state(), random.getstate()  # noqa: NPY002
    replaced: list[tuple[dict[str, Any], str, Any]] = []
    stand_ins = _stand_ins(found, where)
    spaces = [vars(time), vars(datetime), *modules_of(found.kind)]
    try:
        for space in spaces:
            for name, value in list(space.items()):
                stand_in = stand_ins.get(id(value))
                if stand_in is not None:
                    replaced.append((space, name, value))
                    space[name] = stand_in
        yield
    finally:
        for space, name, value in reversed(replaced):
            space[name] = value
        numpy_after, python_after = np.random.get_state(), random.getstate()  # noqa: NPY002
        np.random.set_state(numpy_kept)  # noqa: NPY002
        random.setstate(python_kept)
        how = "draw from `self.random`, or in an environment from `generator(seed, path, turn)`"
        if fingerprint(numpy_after) != fingerprint(numpy_before):
            found.add(where, "draws from the global generator of NumPy (`np.random`)", how)
        if python_after != python_before:
            found.add(where, "draws from the global generator of Python (`random`)", how)


def _stand_ins(found: DeviationList, where: str) -> dict[int, Any]:
    """Return the replacements of the functions of the clock, by the identity of each."""

    def note(name: str, frame: FrameType) -> None:
        if is_code_of(found.kind, frame):
            place = f" ({Path(frame.f_code.co_filename).name}, line {frame.f_lineno})"
            found.add(where, f"reads the wall clock (`{name}`)", "use `self.time` or `self.now`", place)

    def replaced(name: str) -> Any:
        clock = getattr(time, name)

        def stand_in() -> Any:
            note(f"time.{name}", sys._getframe(1))
            return clock()

        return stand_in

    dates: dict[int, Any] = {}
    for kind, names in ((datetime.datetime, ("now", "utcnow", "today")), (datetime.date, ("today",))):
        dates[id(kind)] = _date_stand_in(kind, names, note)
    return {**{id(getattr(time, name)): replaced(name) for name in _CLOCKS}, **dates}


def _date_stand_in(kind: Any, names: Collection[str], note: Any) -> Any:
    class Meta(type):
        def __instancecheck__(cls, instance: object) -> bool:
            return isinstance(instance, kind)

        def __subclasscheck__(cls, each: type) -> bool:
            return issubclass(each, kind)

    def method(name: str) -> Any:
        def call(cls: Any, *arguments: Any, **keywords: Any) -> Any:
            note(f"{kind.__name__}.{name}", sys._getframe(1))
            return getattr(kind, name)(*arguments, **keywords)

        return classmethod(call)

    def new(cls: Any, *arguments: Any, **keywords: Any) -> Any:
        return kind(*arguments, **keywords)

    return Meta(kind.__name__, (kind,), {"__new__": new, **{name: method(name) for name in names}})
