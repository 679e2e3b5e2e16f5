"""Checks of kinds of faults: texts, attributes that stay, durations, and runs that are repeatable and captured."""

from __future__ import annotations

from typing import Any

from pydantic import RootModel

from symaware_cli.engine import Fault
from symaware_cli.language import KINDS
from symaware_cli.testing.conformance import DeviationList, require_kind, unlike
from symaware_cli.testing.side_effects import own_state, watched
from symaware_cli.testing.small_scenario import (
    CHECKED,
    Changes,
    SmallScenario,
    check_run,
    report_failure,
    scenario,
    started,
    trace,
)

_KIND = next(each for each in KINDS if each.name == "fault")


def check_fault(kind: type[Fault], changes: Changes | None = None, /, **parameters: Any) -> None:
    """Check a kind of faults with one that begins at 0.1 s in a run of three agents, and ends at 0.2 s if it lasts.

    `text` and `source` must name the subject of the fault. From `begin` on the attributes of the fault must not change.
    Runs must be equal, and continue alike from a state that was captured while it lasts.

    Args:
        kind: The class.
        changes: Values of the scenario by their paths.
        parameters: The parameters of the fault; ``root=...`` for a single value.

    Raises:
        ConformanceError: A line for each deviation.
    """
    found = require_kind(kind, _KIND)
    if not kind.lasts and kind.end is not Fault.end:
        found.add("end", "is never called, as `lasts` is False", "omit it, or let the fault last")
    content = scenario()
    form: Any = parameters.get("root") if issubclass(kind.Parameters, RootModel) else parameters
    content["faults"] = {"it": {"at": 0.1, **({"for": 0.2} if kind.lasts else {}), CHECKED: form}}
    robot = content["agents"]["robot"]["components"]
    robot |= {"tell": {"use": "communication.state"}, "hear": {"use": "communication.inbox"}}
    small = SmallScenario(content, changes, found)
    calls: dict[str, int] = {}
    with started(small.build(_observed(kind, found, calls))) as run:
        for fault in run.faults:
            _check_words(found, fault)
        trace(run)
        if run.failure is not None:
            report_failure(found, run.failure, "end" if "end" in calls else "begin")
        elif "begin" not in calls:
            found.add("begin", "was not called", "let it begin within the run: {'faults.it.at': 0.1}")
    found.settle()
    check_run(small, "begin")
    found.settle()


def _check_words(found: DeviationList, fault: Fault) -> None:
    if fault.name != "it":
        return
    for name in ("text", "source"):
        with found.calling(name):
            words = getattr(fault, name)
            if not isinstance(words, str) or not words.strip() or "\n" in words:
                found.add(name, f"is {words!r}", "return a few words in one line")
            elif name == "source" and words.partition(".")[0] not in ("agents", "exchange", "faults", "environment"):
                found.add(name, f"is {words!r}", "`agents.` with a name or pattern, `exchange` or `faults`")


def _observed(kind: Any, found: DeviationList, calls: dict[str, int]) -> type:
    """Return a class derived from a kind of faults that observes its methods."""

    def observed(name: str) -> Any:
        def method(self: Any, run: Any, *begun: Any) -> Any:
            calls[name] = calls.get(name, 0) + 1
            before = own_state(self)
            with watched(found, name):
                value = getattr(kind, name)(self, run, *begun)
            for attribute in unlike(before, own_state(self)):
                how = "return what `end` needs from `begin`: it is captured with the run"
                found.add(name, f"changes {attribute}", how)
            return value

        return method

    names = {"__doc__": kind.__doc__, "__module__": kind.__module__}
    return type(kind.__name__, (kind,), {**names, "begin": observed("begin"), "end": observed("end")})
