"""Deviations of a plugin from its requirements, each with the method, the file and line, and a correction."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from pydantic import ValidationError

from symaware_cli.world import PluginKind, describe

#: Advice on exceptions that beginners with arrays meet, by a part of their text.
_ADVICE = {
    "truth value of an array": (
        "branches on an array, which holds a value for each agent",
        "choose by element: `np.where(condition, one, other)`",
    ),
    "can be converted to Python scalars": (
        "gives an array to a function for single numbers",
        "use the functions of NumPy, or those of the argument `math` in a model",
    ),
    "only 0-dimensional arrays can be converted": (
        "gives an array to a function for single numbers",
        "use the functions of NumPy, or those of the argument `math` in a model",
    ),
    "assignment destination is read-only": (
        "writes into an array that it was given",
        "compute a new array, or change a `copy()`",
    ),
    "output array is read-only": (
        "writes into an array that it was given",
        "compute a new array, or change a `copy()`",
    ),
}


class ConformanceError(AssertionError):
    """A plugin violates a requirement of its kind.

    Attributes:
        deviations: Each deviation, in one line: the plugin and its method, file and line, the problem and a correction.
    """

    def __init__(self, deviations: list[str]) -> None:
        super().__init__("\n".join(deviations))
        self.deviations = tuple(deviations)


class DeviationList:
    """Collects the deviations of one plugin.

    Attributes:
        kind: The class of the plugin.
    """

    def __init__(self, kind: type) -> None:
        self.kind = kind
        self._found: dict[str, None] = {}

    def __bool__(self) -> bool:
        return bool(self._found)

    def add(self, where: str, what: str, how: str = "", place: str | None = None) -> None:
        """Add a deviation, unless it is in the list already.

        Args:
            where: The method or attribute; empty for the class.
            what: The problem, as a predicate.
            how: The correction, as an instruction.
            place: The file and line, such as `` (mine.py, line 12)``; by default those of the method's definition.
        """
        owner = f"{self.kind.__name__}.{where}" if where else self.kind.__name__
        place = place_of(self.kind, where) if place is None else place
        self._found[f"{owner}{place} {what}{f'; {how}' if how else ''}"] = None

    def failure(self, where: str, error: BaseException) -> None:
        """Add an exception that a method raised, at the line of the plugin that raised it.

        Args:
            where: The method that was called.
            error: The exception.
        """
        text = describe(error)
        for part, (what, how) in _ADVICE.items():
            if part in text:
                return self.add(where, f"{what}: {text}", how, line_of(self.kind, error))
        return self.add(where, f"raises {text}", place=line_of(self.kind, error))

    @contextmanager
    def calling(self, where: str) -> Iterator[None]:
        """Add exceptions of the block, which calls a method of the plugin."""
        try:
            with np.errstate(all="ignore"):
                yield
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self.failure(where, error)

    def settle(self) -> None:
        """Raise all deviations.

        Raises:
            ConformanceError: There is at least one deviation.
        """
        if self._found:
            raise ConformanceError(list(self._found))


def require_kind(kind: type, of: PluginKind) -> DeviationList:
    """Check that a class is a plugin of a kind, with documented parameters.

    Args:
        kind: The class.
        of: The kind of plugins.

    Returns:
        The list of its deviations, to which further checks add.

    Raises:
        ConformanceError: The class cannot be used at all.
    """
    if not inspect.isclass(kind):
        name = getattr(kind, "__name__", repr(kind))
        raise ConformanceError([f"{name} {of.fault(kind) or 'is not a class'}; give the class itself"])
    found, fault = DeviationList(kind), of.fault(kind)
    if fault is not None:
        found.add("", fault, f"{of.article} {of.name} derives from {' or '.join(each.__name__ for each in of.bases)}")
        found.settle()
    if not (vars(kind).get("__doc__") or "").strip():
        found.add("", "has no docstring", "describe in a line what it does, for `symaware show`")
    if hasattr(kind, "Parameters"):
        for name, field in kind.Parameters.model_fields.items():
            if not field.description:
                found.add("Parameters", f"does not describe `{name}`", "state meaning and unit: Field(description=...)")
    return found


def with_parameters(found: DeviationList, parameters: Mapping[str, Any]) -> Any:
    """Create a plugin with parameters.

    Args:
        found: Receives the deviations.
        parameters: Its parameters by name.

    Raises:
        ConformanceError: The plugin cannot be created.
    """
    kind: Any = found.kind
    try:
        made = kind.Parameters.model_validate(dict(parameters))
    except ValidationError as error:
        for each in error.errors(include_url=False):
            name = ".".join(str(part) for part in each["loc"]) or "the parameters"
            found.add("Parameters", f"refuse `{name}`: {each['msg']}", "give the parameters of the check as keywords")
        found.settle()
    with found.calling("__init__"):
        plugin = kind(made)
    found.settle()
    return plugin


def place_of(kind: type, where: str) -> str:
    """Return the file and line of the definition of a method, or of the class; empty if unknown."""
    name = where.partition("(")[0]
    for each in kind.__mro__:
        if each.__module__.partition(".")[0] != kind.__module__.partition(".")[0]:
            break  # a method inherited from this package is not the plugin's
        member: Any = vars(each).get(name)
        member = getattr(member, "fget", member)
        code = getattr(inspect.unwrap(member) if callable(member) else member, "__code__", None)
        if code is not None:
            return f" ({Path(code.co_filename).name}, line {code.co_firstlineno})"
    try:
        return f" ({Path(inspect.getfile(kind)).name}, line {inspect.getsourcelines(kind)[1]})"
    except (OSError, TypeError):
        return ""


def method_of(kind: type, error: BaseException) -> str | None:
    """Return the method of a plugin that was running when an exception was raised; None if there was none."""
    trace = error.__traceback__
    while trace is not None:
        name = trace.tb_frame.f_code.co_name
        if is_code_of(kind, trace.tb_frame) and inspect.isroutine(inspect.getattr_static(kind, name, None)):
            return name
        trace = trace.tb_next
    return None


def line_of(kind: type, error: BaseException) -> str | None:
    """Return the file and line of a plugin that an exception comes from; None if it is not from its code."""
    place = None
    trace = error.__traceback__
    while trace is not None:
        if is_code_of(kind, trace.tb_frame):
            place = f" ({Path(trace.tb_frame.f_code.co_filename).name}, line {trace.tb_lineno})"
        trace = trace.tb_next
    return place


def is_code_of(kind: type, frame: FrameType) -> bool:
    """Whether a frame executes code of the package, or the file, of a plugin."""
    name = frame.f_globals.get("__name__", "")
    root = kind.__module__.partition(".")[0]
    if root == "symaware_cli":  # other modules of this package call the plugin
        return bool(name == kind.__module__)
    return bool(name.partition(".")[0] == root)


def modules_of(kind: type) -> list[dict[str, Any]]:
    """Return the namespaces of the modules of a plugin's package that are imported."""
    root = kind.__module__.partition(".")[0]
    names = [kind.__module__]
    if root != "symaware_cli":
        names = [each for each in sys.modules if each.partition(".")[0] == root]
    return [vars(sys.modules[name]) for name in names if sys.modules.get(name) is not None]


def unlike(one: Mapping[str, str], other: Mapping[str, str]) -> list[str]:
    """Return the names of the entries in which two mappings of fingerprints differ, sorted."""
    return sorted(each for each in {*one, *other} if one.get(each) != other.get(each))
