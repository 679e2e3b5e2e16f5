"""Collects and checks the parts of awareness and the signals that the components of a group declare."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

from symaware_cli.awareness import MEASUREMENT
from symaware_cli.core import PARTS, AgentGroup, Part, Quantity, Signal
from symaware_cli.core.component import BaseComponent
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.problem import dotted, nearest, quoted
from symaware_cli.language.source import Path
from symaware_cli.log import FIELDS, KINDS, TABLES


@cache
def _taken() -> frozenset[str]:
    """Names that have another meaning in logs, tables, expressions or messages."""
    from symaware_cli.engine import AGENT_NAMES
    from symaware_cli.specification.columns import FUNCTIONS

    return frozenset({*TABLES, *FIELDS, *KINDS, *AGENT_NAMES, *FUNCTIONS, "id"})


def declared_by(plugin: Any) -> Sequence[Part]:
    """The parts that a plugin declares; none if its declaration is not a list of parts."""
    return _checked_list(getattr(plugin, "parts", ()), Part) or ()


def signals_of(plugin: Any) -> Sequence[Signal]:
    """The signals that a plugin declares; none if its declaration is not a list of signals."""
    return [each for each in _checked_list(getattr(plugin, "signals", ()), Signal) or () if not isinstance(each, Part)]


def _checked_list(declared: Any, kind: type) -> Sequence[Any] | None:
    return declared if isinstance(declared, Sequence) and all(isinstance(each, kind) for each in declared) else None


def declared_parts(components: Iterable[tuple[BaseComponent[Any], str, Path]], diagnosis: Diagnosis) -> Sequence[Part]:
    """Collect the parts that the components of a group declare, besides those of every group.

    Args:
        components: Each component with its entry-point name and its path.
        diagnosis: Takes problems.

    Returns:
        The valid parts; problems with all others are reported.
    """
    known: dict[str, tuple[Part, str]] = {part.name: (part, "") for part in PARTS}
    for component, use, path in components:
        parts = _checked_list(component.parts, Part)
        if parts is None:
            diagnosis.report("broken-plugin", f"the `parts` of {quoted(use)} are not a list of `Part`", path, key=True)
            continue
        for part in parts:
            other, by = known.get(part.name, (part, ""))
            if other != part:
                whose = quoted(by) if by else "every agent"
                message = f"{quoted(use)} and {whose} declare different parts {quoted(part.name)}"
                diagnosis.report(
                    "unsuitable", message, path, key=True, expected="one of the two components, or another name"
                )
            elif part.name not in known and part.name in _taken():
                message = f"{quoted(use)} declares a part {quoted(part.name)}, a name that has another meaning"
                diagnosis.report("broken-plugin", message, path, key=True)
            elif part.kind == "vector" and part.columns is None and part.name not in known:
                message = f"{quoted(use)} declares a part {quoted(part.name)}, a vector, without columns"
                diagnosis.report("broken-plugin", message, path, key=True)
            else:
                known.setdefault(part.name, (part, use))
    return [part for part, use in known.values() if use]


def declared_signals(
    components: Iterable[tuple[BaseComponent[Any], str, Path]], diagnosis: Diagnosis
) -> dict[str, Signal]:
    """Collect the signals that the components of a group declare.

    Args:
        components: Each component with its entry-point name and its path, which ends with the component's name.
        diagnosis: Takes problems.

    Returns:
        The valid signals, by component and name; problems with all others are reported.
    """
    found: dict[str, Signal] = {}
    for component, use, path in components:
        signals = _checked_list(component.signals, Signal)
        if signals is None or any(isinstance(signal, Part) for signal in signals):
            diagnosis.report(
                "broken-plugin", f"the `signals` of {quoted(use)} are not a list of `Signal`", path, key=True
            )
            continue
        for signal in signals:
            field = signal.field(str(path[-1]))
            if signal.name != MEASUREMENT and signal.name in _taken():
                message = f"{quoted(use)} declares a signal {quoted(signal.name)}, a name that has another meaning"
            elif signal.kind != "series" and signal.columns is None:
                message = f"{quoted(use)} declares a signal {quoted(signal.name)}, a {signal.kind}, without columns"
            elif field in found:
                message = f"{quoted(use)} declares two signals {quoted(signal.name)}"
            else:
                found[field] = signal
                continue
            diagnosis.report("broken-plugin", message, path, key=True)
    return found


def name_columns(group: AgentGroup, component: BaseComponent[Any]) -> None:
    """Set the columns of series as a component declares them in `series_quantities`.

    Raises:
        ValueError: The declaration has the wrong type, or names something that is not a series of the group.
    """
    declared = component.series_quantities(group)
    sound = isinstance(declared, Mapping) and all(
        isinstance(columns, Sequence) and all(isinstance(each, Quantity) for each in columns)
        for columns in declared.values()
    )
    if not sound:
        raise ValueError(f"`series_quantities` returned {declared!r:.100}, not a list of `Quantity` for each series")
    parts = group.awareness.parts
    for name, columns in declared.items():
        part = parts.get(name)
        if part is None or part.kind != "series":
            series = ", ".join(name for name, part in parts.items() if part.kind == "series")
            raise ValueError(f"`series_quantities` names {name!r}, but the series are {series}")
        parts[name] = part.of(columns)


def check_omitted(omit: Any, declared: Iterable[str], diagnosis: Diagnosis) -> None:
    """Report unknown names in `recording.omit`.

    Args:
        omit: The value of `recording.omit`.
        declared: The names of the parts and signals that components declare.
        diagnosis: Takes problems.
    """
    known = omittable(declared)
    for place, name in enumerate(omit if isinstance(omit, list) else ()):
        if isinstance(name, str) and name not in known:
            where: Path = ("recording", "omit", place)
            diagnosis.report(
                "invalid-value",
                f"{quoted(dotted(where))} is the text {quoted(name)}",
                where,
                expected=f"one of {', '.join(known)}",
                suggestion=nearest(name, known),
            )


def omittable(declared: Iterable[str]) -> list[str]:
    """The names that `recording.omit` may contain.

    Args:
        declared: The names of the parts and signals that components declare.
    """
    # Measurements are omitted by `sensors`, together with all else that sensors record.
    return list(dict.fromkeys([*(part.name for part in PARTS), *KINDS, *sorted({*declared} - {MEASUREMENT})]))
