"""Verification of a log by repeating its run: bitwise equality, or the first difference and its cause.

If the log states that a component repeats its results to a tolerance only, numbers are compared to that.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from symaware_cli.awareness import Column, SeriesColumn
from symaware_cli.core import AgentGroup, Event, seconds
from symaware_cli.engine import Simulation
from symaware_cli.evidence.message_comparison import MessageComparison
from symaware_cli.evidence.tolerances import Tolerances
from symaware_cli.language import open_scenario, prepared
from symaware_cli.language.versions import versions
from symaware_cli.log import OUTCOME, Log, LogDifference, LogError, attachment_differences, first_difference, open_log
from symaware_cli.studies import counting

#: The number of steps between two checks that the run still equals the log.
_STEPS = 100


@dataclass(frozen=True, slots=True)
class VersionDifference:
    """A difference in an installed version or in the machine from when the log was written.

    Attributes:
        name: The name of the package or property.
        then: The version in the log, or in the first of two logs; None if not installed.
        now: The version here, or in the second log; None if not installed.
    """

    name: str
    then: str | None
    now: str | None


@dataclass(frozen=True, slots=True)
class VerificationResult:
    """The result of comparing a log with a repetition of its run.

    Attributes:
        log: The log.
        scenario: The name of its scenario.
        seed: The seed of the run.
        messages: The number of equal messages, from the first on, and of those that differ within the tolerance.
        until: The simulated time until which both were compared [s].
        is_whole: Whether the log reaches the end of its run; otherwise it was compared up to its end.
        difference: The first difference; None if all messages are equal.
        writer: The path of the component that wrote the differing value, or ``environment``; "" if unknown.
        attachments: The differences in attachments, outcome and channel metadata about columns.
        versions: The differences in versions and machine.
        damage: The part of the log that could not be read; None if undamaged.
        tolerances: The components that repeat their results to a tolerance only, by path, as the log states them; the
            greatest holds for all numbers.
        tolerated: The number of messages that differ within the tolerance.
        greatest: The greatest difference within the tolerance; None if there is none.
    """

    log: Path
    scenario: str
    seed: int
    messages: int
    until: float
    is_whole: bool
    difference: LogDifference | None
    writer: str
    attachments: Sequence[LogDifference]
    versions: Sequence[VersionDifference]
    damage: str | None = None
    tolerances: Mapping[str, float] = field(default_factory=dict)
    tolerated: int = 0
    greatest: LogDifference | None = None

    @property
    def is_equal(self) -> bool:
        """Whether the logs are equal, within the tolerance if the log states one."""
        return self.difference is None and not self.attachments

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain data."""
        return {"equal": self.is_equal, **asdict(self), "log": str(self.log)}


def verify_log(
    path: str | os.PathLike[str], on_progress: Callable[[int, int], object] | None = None
) -> VerificationResult:
    """Repeat the run of a log from the scenario that it contains, comparing messages as it runs.

    Args:
        path: The log.
        on_progress: Called periodically with the number of completed steps and the total.

    Raises:
        LogError: The log cannot be read, has no scenario, or contains only one part of a run in several processes.
        ScenarioError: Its scenario is invalid here, such as because a plugin is not installed.
        KeyboardInterrupt: A signal ended the run.
    """
    path = Path(path)
    log = open_log(path)
    if "part" in log.manifest:
        raise LogError(f"{path} is a part of a run in several processes: verify the log that `symaware merge` makes")
    built = open_scenario(path)
    tolerances = stated_tolerances(log)
    allowed = Tolerances.everywhere(max(tolerances.values())).allow if tolerances else None
    comparison = MessageComparison(log, allowed=allowed)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, "repeated.mcap")
        with prepared(built, copy, may_exit=False, on_message=comparison.compare) as run:
            while run.status is None and not comparison.is_over:
                run.advance(_STEPS)
                if on_progress is not None:
                    on_progress(run.kernel.done, built.steps)
        if run.signal is not None:
            raise KeyboardInterrupt
        repeated = open_log(copy)
        difference, writer = None, ""
        if comparison.differs or (comparison.is_whole and comparison.is_left):
            difference = first_difference(log, repeated, allowed)
        if difference is not None:
            writer = _writer(path, difference)
        ended = run.status is not None and comparison.is_whole
        found = attachment_differences(log, repeated, allowed)
        attachments = [each for each in found if ended or each.topic != OUTCOME]
    return VerificationResult(
        path,
        built.document.name,
        built.document.seed,
        comparison.count,
        seconds(comparison.now),
        comparison.is_whole,
        difference,
        writer,
        attachments,
        version_differences(logged_versions(log), counting(versions())),
        str(log.damage) if log.damage and log.damage.lost else None,
        tolerances,
        comparison.tolerated,
        comparison.greatest,
    )


def stated_tolerances(log: Log) -> Mapping[str, float]:
    """Return the components that repeat their results to a tolerance only, by path, as a log states them."""
    found: Mapping[str, float] = log.manifest.get("repeatable_to", {})
    return found


def logged_versions(log: Log) -> dict[str, str]:
    """Return the versions that affect results, as recorded in a log."""
    return counting(json.loads(log.attachments.get("versions.json", b"{}")))


def version_differences(then: Mapping[str, str], now: Mapping[str, str]) -> Sequence[VersionDifference]:
    """Return the differences between two sets of versions."""
    return [
        VersionDifference(name, then.get(name), now.get(name))
        for name in sorted({*then, *now})
        if then.get(name) != now.get(name)
    ]


def _writer(path: Path, difference: LogDifference) -> str:
    """Return the component that wrote a differing value, found by repeating the run while watching every update."""
    parts = difference.topic.split("/")
    if parts[1:2] == ["world"] or difference.topic == "/contacts":
        return "environment"
    if parts[1:2] != ["agents"] or difference.time is None:
        return ""
    if len(parts) == 5:
        return f"agents.{parts[2]}.{parts[4]}"
    built = open_scenario(path)
    simulation = built.simulation
    group = next((each for each in simulation.groups if each.name == parts[2]), None)
    if group is None:
        return ""
    watch = _Watch(simulation, group, parts[3], difference.time)
    with prepared(built, None, may_exit=False) as run:
        while run.status is None and simulation.clock.now <= difference.time:
            run.advance(1)
    return watch.writer


class _Watch:
    """Records which component changes a part of the awareness of a group.

    Attributes:
        writer: The path of the last component that changed it until a given time; "" if none did.
    """

    def __init__(self, simulation: Simulation, group: AgentGroup, part: str, until: int) -> None:
        self.writer = ""
        self._group = group
        self._part = part
        self._until = until
        self._before = self._present()
        simulation.events.subscribe("updated", self._on_update)

    def _on_update(self, event: Event) -> None:
        if event.time > self._until or not event.source.startswith(f"agents.{self._group.name}."):
            return
        present = self._present()
        if present != self._before:
            self._before, self.writer = present, event.source

    def _present(self) -> object:
        group, part = self._group, self._part
        if part == "control":
            return group.control_input.tobytes()
        if part == "knowledge":
            return repr([dict(each) for each in group.knowledge])
        if part == "awareness":
            seen = group.awareness.seen
            return None if seen is None else (seen.time, seen.positions.tobytes(), seen.velocities.tobytes())
        column = group.awareness.columns.get(part)
        match column:
            case Column():
                return column.values.tobytes()
            case SeriesColumn():
                rows = [column.row(row) for row in range(len(group))]
                return [(each.times.tobytes(), each.values.tobytes()) for each in rows]
        return None
