"""Branches: the run of a log up to an instant, and from there on with something changed."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symaware_cli.api.changes import Changes, texts
from symaware_cli.api.message_comparison import MessageComparison
from symaware_cli.api.scenario import FilePath
from symaware_cli.core import nanoseconds
from symaware_cli.recording.error import LogError
from symaware_cli.recording.reader import Log, open_log
from symaware_cli.runtime.run_summary import RunSummary
from symaware_cli.scenario.compose import compose
from symaware_cli.scenario.execution import prepared
from symaware_cli.scenario.files import check_output, extracted, open_scenario
from symaware_cli.scenario.plugin_factory import mapping

#: How many steps are made between two looks at whether the run still equals the log.
_STEPS = 100

_EVENT = re.compile(r"\s*(?P<name>[\w-]+)\((?P<of>[^()]*)\)\s*(?P<shift>[+-]\s*[\d.]+)?\s*")

_CAN_CHANGE = (
    "a component (agents.GROUP.components.NAME.use, and what the new one has under with), parameters of one "
    "(agents.GROUP.components.NAME.with.PARAMETER), knowledge (agents.GROUP.knowledge.NAME), a state "
    "(agents.GROUP.state), each also of one agent (agents.GROUP.2.state), faults (faults.NAME), and run"
)


class BranchError(LogError):
    """A branch cannot be made: there is no such instant, or the change is none that can begin at one."""


@dataclass(frozen=True, slots=True)
class BranchResult:
    """A branch of a run.

    Attributes:
        log: The log that it was made from.
        at: The instant from which on it may differ [s].
        equal: How many messages before it are equal to those of the log: all.
        changes: What was changed, in the form of ``--set``.
        summary: The figures of the branch, with the path of its own log.
    """

    log: Path
    at: float
    equal: int
    changes: Sequence[str]
    summary: RunSummary

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain data."""
        return {
            "log": str(self.log),
            "at": self.at,
            "equal": self.equal,
            "changes": list(self.changes),
            "run": self.summary.to_json(),
        }


def branch(
    log: FilePath,
    at: float | str,
    changes: Changes | None = None,
    output: FilePath | None = None,
    on_progress: Callable[[int, int], object] | None = None,
) -> BranchResult:
    """Repeat the run of a log up to an instant, and let it continue with something changed.

    What is changed becomes a fault of the branch's scenario (docs/time.md, "Faults") that begins at the instant, so the
    branch is a run like any other: its log can be verified, compared and branched again. Without a change it is the
    same run.

    Args:
        log: The log.
        at: The instant [s]; or an event of the log, with a shift, such as ``violated(safe) - 2.0``.
        changes: What changes then, by the paths of the scenario: components, their parameters, knowledge, a state;
            faults, which begin then unless they say when; values under ``run``.
        output: The log of the branch; None for none.
        on_progress: Called from time to time with the number of steps that were made, and that of all.

    Raises:
        LogError: The log cannot be read or written.
        BranchError: There is no such instant, it cannot be changed then, or the change affects what was before.
        ScenarioError: The scenario with the change has problems.
        KeyboardInterrupt: A signal ended the run.
    """
    log, output = Path(log), None if output is None else Path(output)
    original = open_log(log)
    if "part" in original.manifest:
        raise BranchError(f"{log} is a part of a run in several processes: branch the log that `symaware merge` makes")
    instant = _instant(original, log, at)
    overrides = _overrides(log, instant, texts(changes))
    built = open_scenario(log, overrides)
    if output is not None:
        check_output(built, output, log)
    comparison = MessageComparison(original, nanoseconds(instant) if overrides else None)
    with tempfile.TemporaryDirectory() as folder:
        written = output or Path(folder, "branch.mcap")
        with prepared(built, written, may_exit=False, on_message=comparison.compare) as run:
            while run.status is None and not comparison.differs:
                run.advance(_STEPS)
                if on_progress is not None:
                    on_progress(run.kernel.done, built.steps)
            if comparison.differs:
                run.leave("the branch differs before its instant")
        if run.signal is not None:
            raise KeyboardInterrupt
        if comparison.differs or comparison.is_left:
            written.unlink(missing_ok=True)
            where = f"it differs from {log} after {comparison.now / 1e9:g} s already"
            cause = "what is changed affects the run before the instant" if overrides else "the run does not repeat"
            raise BranchError(f"there is no such branch: {where}; {cause}. See `symaware verify {log}`")
    return BranchResult(log, instant, comparison.count, overrides, run.summary)


def _instant(original: Log, log: Path, at: float | str) -> float:
    """The instant of a branch [s], within the run."""
    end = (original.end_time or 0) / 1e9
    instant = at if isinstance(at, int | float) else _described(original, log, at)
    if not 0.0 <= instant <= end:
        raise BranchError(f"{instant:g} s is not within the run of {log}, which goes from 0 to {end:g} s")
    return instant


def _described(original: Log, log: Path, at: str) -> float:
    try:
        return float(at)
    except ValueError:
        found = _EVENT.fullmatch(at)
    if found is None:
        raise BranchError(f"`{at}` is no instant: write a time [s], or an event as in `violated(safe) - 2.0`")
    name, of = found["name"], found["of"].strip()
    events = [event for event in original.events() if event.name == name]
    for event in events:
        if of in ("", event.source, event.source.removeprefix("specifications.")):
            return event.time / 1e9 + float((found["shift"] or "0").replace(" ", ""))
    sources = sorted({event.source.removeprefix("specifications.") for event in events})
    there = f"only of {', '.join(sources)}" if sources else "nor any other of this name"
    raise BranchError(f"there is no event {name}({of}) in {log}, {there}")


def _overrides(log: Path, instant: float, changes: Sequence[str]) -> Sequence[str]:
    """Translate changes of a scenario to changes of its faults, which begin at the instant."""
    with tempfile.TemporaryDirectory() as folder:
        file, _ = extracted(log, Path(folder))
        own = [_unindexed(change) for change in changes]
        data = compose(file, own, name=str(log)).data
    direct: dict[str, Any] = {}
    faults: dict[tuple[str, str], dict[str, Any]] = {}
    for change in changes:
        keys = [key.strip() for key in change.partition("=")[0].split(".")]
        match keys:
            case ["run", *_]:
                direct[".".join(keys)] = _value(data, keys)
            case ["faults", name, *_]:
                content = _value(data, ["faults", name])
                if isinstance(content, Mapping) and "at" not in content and "on" not in content:
                    content = {"at": instant, **content}
                direct[f"faults.{name}"] = content
            case ["agents", group, *rest]:
                of, rest = (f"{group}.{rest[0]}", rest[1:]) if rest and rest[0].isdecimal() else (group, rest)
                _add(faults, of, _value(data, ["agents", group]), rest, change)
            case _:
                raise BranchError(f"`{change}` cannot change at an instant; what can: {_CAN_CHANGE}")
    taken = data.get("faults") or {}
    numbers = (number for number in range(1, len(taken) + len(faults) + 2) if f"branch-{number}" not in taken)
    for (kind, of), content in _without_replaced(faults).items():
        direct[f"faults.branch-{next(numbers)}"] = {"at": instant, kind: {"of": of, **content}}
    return texts(direct)


def _add(
    faults: dict[tuple[str, str], dict[str, Any]], of: str, group: Mapping[str, Any], rest: Sequence[str], change: str
) -> None:
    """Add the change of a part of a group, or of one of its agents."""
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
            raise BranchError(f"`{change}` cannot change at an instant; what can: {_CAN_CHANGE}")


def _without_replaced(faults: dict[tuple[str, str], dict[str, Any]]) -> dict[tuple[str, str], dict[str, Any]]:
    """Let parameters of a component that is replaced be those of the new one, which has none of the old one's."""
    kept = dict(faults)
    for kind, of in faults:
        if kind == "replace" and (changed := kept.pop(("reconfigure", of), None)) is not None:
            kept[kind, of] = {**kept[kind, of], **changed}
    return kept


def _unindexed(change: str) -> str:
    """A change of one agent as one of its group, to read its value."""
    return re.sub(r"^(\s*agents\.[^.=]+)\.\d+(?=\.)", r"\1", change)


def _value(data: Mapping[str, Any], keys: Sequence[str]) -> Any:
    found: Any = data
    for key in keys:
        found = found.get(key) if isinstance(found, Mapping) else None
    return found
