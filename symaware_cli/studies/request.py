"""Requests for sweeps from the command line or Python, as assignments to the document of a sweep."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from symaware_cli.language import Assignment, Changes, ScenarioError, assignments, dotted
from symaware_cli.world import expanded, is_range

Over = Mapping[str, Iterable[Any] | Mapping[str, Any] | str] | Iterable[str] | Iterable[Assignment]
"""The varied parameters: lists, ranges or distributions by path, or texts in the syntax of ``--over``."""


@dataclass(frozen=True, slots=True)
class SweepRequest:
    """Options of a sweep; all other values of the file remain unchanged.

    Attributes:
        over: The varied parameters.
        set: The changes to all runs.
        entries: Further entries of the document, by ``key`` or ``key.name``.
    """

    over: Over = ()
    set: Changes = ()
    entries: Changes = ()

    def assignments(self) -> Iterator[Assignment]:
        """Yield the assignments by which the options replace or add values of the document."""
        yield from (each.inside("over") for each in varied(self.over))
        yield from (each.inside("set") for each in assignments(self.set))
        yield from (each.inside(own=1) for each in assignments(self.entries, "--with"))


def varied(over: Over) -> tuple[Assignment, ...]:
    """Return the varied parameters as assignments of lists, ranges or distributions.

    Raises:
        TypeError: A value has a type that scenarios do not support.
    """
    if isinstance(over, Mapping):
        return tuple(_varied(path, values) for path, values in over.items())
    return tuple(_parsed(each) if isinstance(each, str) else each for each in over)


def _varied(path: str, values: Iterable[Any] | Mapping[str, Any] | str) -> Assignment:
    if isinstance(values, str):
        return _parsed(f"{path}={values}")
    if isinstance(values, Mapping):
        return Assignment.of(path, values, "--over")
    return Assignment.of(path, list(values), "--over", listed=True)


def _parsed(text: str) -> Assignment:
    return Assignment.parse(text, "--over", listed=not is_range(text.partition("=")[2]))


def alternatives(varying: Assignment) -> list[Assignment]:
    """Return one assignment for each value of a list or a range.

    Raises:
        ScenarioError: The value is neither.
    """
    source, span = varying.source.copy(), varying.value.span
    values: Any = None
    try:
        values = expanded(varying.value.plain())
    except ValueError as error:
        source.report("invalid-value", str(error), span, varying.path)
    if not (source.problems or (isinstance(values, list) and values)):
        expected = "values such as 1,2,5, or a range such as 0..1 by 0.1"
        source.report("wrong-type", "this is no list of values", span, varying.path, expected=expected)
    if source.problems:
        raise ScenarioError(source.problems)
    return [Assignment.of(dotted(varying.path), each) for each in values]
