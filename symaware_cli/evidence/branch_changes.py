"""Changes to a run at an instant, converted to faults of the branch's scenario that begin at that instant."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from symaware_cli.language import Assignment, assignments, dotted, extracted, mapping
from symaware_cli.language.compose import compose
from symaware_cli.log import LogError

_CAN_CHANGE = (
    "a component (agents.GROUP.components.NAME.use, and its parameters under with), parameters of one "
    "(agents.GROUP.components.NAME.with.PARAMETER), knowledge (agents.GROUP.knowledge.NAME), a state "
    "(agents.GROUP.state), each also of one agent (agents.GROUP[2].state), faults (faults.NAME), and run"
)


class BranchError(LogError):
    """A branch cannot be created: the instant does not exist, or the change cannot begin at an instant."""


def overrides_of(log: Path, instant: float, changes: Sequence[Assignment]) -> Sequence[Assignment]:
    """Convert changes to a scenario into changes to its faults that begin at the instant.

    Args:
        log: The log.
        instant: The instant [s].
        changes: The changes.

    Raises:
        BranchError: A change cannot begin at an instant.
        ScenarioError: A change names something that the scenario does not contain.
    """
    with tempfile.TemporaryDirectory() as folder:
        file, _ = extracted(log, Path(folder))
        own = [_unindexed(change) for change in changes]
        data = compose(file, own, name=str(log)).data
    direct: dict[str, Any] = {}
    faults: dict[tuple[str, str], dict[str, Any]] = {}
    for change in changes:
        keys = list(change.path)
        match keys:
            case ["run", *_]:
                direct[dotted(keys)] = _value(data, keys)
            case ["faults", name, *_]:
                content = _value(data, ["faults", name])
                if isinstance(content, Mapping) and "at" not in content and "on" not in content:
                    content = {"at": instant, **content}
                direct[f"faults.{name}"] = content
            case ["agents", group, *rest]:
                is_one = bool(rest) and isinstance(rest[0], int)
                of, rest = (f"{group}.{rest[0]}", rest[1:]) if is_one else (str(group), rest)
                _add(faults, of, _value(data, ["agents", group]), rest, change)
            case _:
                raise BranchError(f"`{change}` cannot change at an instant, unlike {_CAN_CHANGE}")
    taken = data.get("faults") or {}
    numbers = (number for number in range(1, len(taken) + len(faults) + 2) if f"branch-{number}" not in taken)
    for (kind, of), content in _without_replaced(faults).items():
        direct[f"faults.branch-{next(numbers)}"] = {"at": instant, kind: {"of": of, **content}}
    return assignments(direct)


def _add(
    faults: dict[tuple[str, str], dict[str, Any]],
    of: str,
    group: Mapping[str, Any],
    rest: Sequence[str | int],
    change: Assignment,
) -> None:
    """Add the change to a part of a group or of one of its agents."""
    match rest:
        case ["components", name] if {"use"} <= {*mapping(_value(group, rest))} <= {"use", "with"}:
            faults["replace", f"{of}.{name}"] = {**_value(group, rest)}
        case ["components", name, "use"]:
            faults.setdefault(("replace", f"{of}.{name}"), {})["use"] = _value(group, rest)
        case ["components", name, "with", parameter, *_]:
            value = _value(group, rest[:4])
            faults.setdefault(("reconfigure", f"{of}.{name}"), {"with": {}})["with"][parameter] = value
        case ["knowledge", name, *_]:
            faults.setdefault(("inform", of), {"knowledge": {}})["knowledge"][name] = group["knowledge"].get(name)
        case ["state"]:
            faults["place", of] = {"state": group["state"]}
        case _:
            raise BranchError(f"`{change}` cannot change at an instant, unlike {_CAN_CHANGE}")


def _without_replaced(faults: dict[tuple[str, str], dict[str, Any]]) -> dict[tuple[str, str], dict[str, Any]]:
    """Apply changed parameters of a replaced component to its replacement, which inherits no parameters."""
    kept = dict(faults)
    for kind, of in faults:
        if kind == "replace" and (changed := kept.pop(("reconfigure", of), None)) is not None:
            kept[kind, of] = {**kept[kind, of], **changed}
    return kept


def _unindexed(change: Assignment) -> Assignment:
    """Return the change of one agent as a change of its group, to parse its value."""
    match change.path:
        case ["agents", str(), int(), _, *_]:
            return change.without(2)
    return change


def _value(data: Mapping[str, Any], keys: Sequence[str | int]) -> Any:
    found: Any = data
    for key in keys:
        is_item = isinstance(found, list) and isinstance(key, int) and key < len(found)
        found = found[key] if is_item else found.get(key) if isinstance(found, Mapping) else None
    return found
