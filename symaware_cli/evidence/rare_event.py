"""Rare events of scenarios: verdicts of specifications that runs approach through levels of robustness."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final, Literal, get_args

from symaware_cli.core.stateful import StateError
from symaware_cli.engine import Run, SimulationState, capture, restore
from symaware_cli.language import prepared
from symaware_cli.language.build import Built
from symaware_cli.studies import SweepError, unknown_specification
from symaware_cli.version import __version__

#: The verdict that constitutes the event: ``violated`` or ``satisfied``.
EventKind = Literal["violated", "satisfied"]
EVENT_KINDS: tuple[EventKind, ...] = get_args(EventKind)


class _Happened(Enum):
    HAPPENED = "happened"


#: The final state after the event, from which runs are not continued.
HAPPENED: Final = _Happened.HAPPENED

#: The end of a stage: a state to continue from, or the event itself.
SplitState = SimulationState | Literal[_Happened.HAPPENED]


@dataclass(frozen=True, slots=True)
class RareEvent:
    """An event at the end of stages.

    Attributes:
        specification: The name of the specification.
        kind: The verdict on it, over all agents or pairs that it applies to.
        levels: The robustness at which each stage but the last one ends, in the unit of the formula: descending towards
            a violation, ascending towards satisfaction. The last stage ends with the verdict.
    """

    specification: str
    kind: EventKind
    levels: tuple[float, ...] = ()

    @property
    def stages(self) -> int:
        """The number of stages."""
        return len(self.levels) + 1

    @property
    def sign(self) -> int:
        """The sign of the change in robustness towards the event: 1 if it rises, -1 if it falls."""
        return 1 if self.kind == "satisfied" else -1

    def check(self, built: Built) -> None:
        """Check that the event is defined for a scenario.

        Raises:
            SweepError: It is not; the message gives the reason.
        """
        known = {each.name: each for each in built.options.specifications}
        found = known.get(self.specification)
        if found is None:
            raise unknown_specification(self.specification, known)
        if found.offer is not None:
            raise SweepError(
                f"`{self.specification}` is offered to agents: only those that always count can be estimated"
            )
        if not self.levels:
            return
        if found.automaton is not None:
            raise SweepError(
                f"`{self.specification}` is a formula of linear temporal logic, which has no robustness: no levels "
                "lead to it"
            )
        towards = [self.sign * level for level in self.levels]
        if not all(map(math.isfinite, towards)) or sorted(set(towards)) != towards or towards[-1] >= 0.0:
            order = "ascending and below 0" if self.sign > 0 else "descending and above 0"
            raise SweepError(
                f"levels towards `{self.specification}` being {self.kind} are {order}, not "
                f"{', '.join(f'{level:g}' for level in self.levels)}"
            )


class SplitRun:
    """A run that is reset to earlier states and continued from them with other random numbers; see `splitting.Process`.

    Attributes:
        event: The event; it may be replaced by one with other levels between trials.
        steps: The total number of steps executed.
        failed: The number of trials that a failing component ended; they do not reach the end of their stage.
    """

    def __init__(self, run: Run, event: RareEvent, scenario: str) -> None:
        """Prepare a run that has not begun.

        Args:
            run: The run, without a log.
            event: The event.
            scenario: The digest of its scenario.

        Raises:
            SweepError: A component failed at the beginning.
            KeyboardInterrupt: A signal ended the run.
        """
        self.steps = 0
        self.failed = 0
        self._run = run
        self.event = event
        self._scenario = scenario
        self._monitor = next(
            each for each in run.specification_monitors if each.specification.name == event.specification
        )
        run.advance(0)
        if run.signal is not None:
            raise KeyboardInterrupt
        if run.failure is not None:
            raise SweepError(f"the run failed at the beginning: {run.failure.problem}")

    @property
    def has_robustness(self) -> bool:
        """Whether the specification has a robustness, unlike formulas of linear temporal logic."""
        return self._monitor.specification.automaton is None

    def begin(self) -> SplitState:
        """Return the state before the first step.

        Raises:
            SweepError: The state cannot be captured; the message names the cause.
        """
        return self._captured()

    def reach(self, state: SplitState, stage: int, seed: int) -> SplitState | None:
        """Continue from a state to the end of a stage or of the run; see `splitting.Process`.

        Raises:
            SweepError: The state there cannot be captured.
            KeyboardInterrupt: A signal ended the run.
        """
        if state is HAPPENED:
            return state
        if not self._continue(state, seed, lambda: self._is_over(stage)):
            return None
        if self._has_happened():
            return HAPPENED
        # A run that has ended cannot be continued.
        return self._captured() if self._run.status is None and self._is_at_level(stage) else None

    def closest(self, state: SplitState, seed: int) -> float:
        """Continue from a state to the event or the end of the run, and return the closest approach to the event.

        Returns:
            The robustness closest to the event, with the sign chosen such that it rises towards the event; infinity if
                the event happened, and minus infinity if a component failed.

        Raises:
            KeyboardInterrupt: A signal ended the run.
        """
        if state is HAPPENED:
            return math.inf
        found = -math.inf

        def is_over() -> bool:
            nonlocal found
            found = max(found, self._closeness())
            return self._is_over(len(self.event.levels))

        if not self._continue(state, seed, is_over):
            return -math.inf
        return math.inf if self._has_happened() else found

    def _continue(self, state: SimulationState, seed: int, is_over: Callable[[], bool]) -> bool:
        """Continue from a state to the end of a trial; return False if a component failed."""
        run = self._run
        restore(run, state, self._scenario, __version__, seed)
        before = run.done
        if not is_over():
            run.advance(until=is_over)
        self.steps += run.done - before
        if run.signal is not None:
            raise KeyboardInterrupt
        self.failed += run.failure is not None
        return run.failure is None

    def _is_over(self, stage: int) -> bool:
        """Return whether a stage has ended, or the event can no longer happen."""
        return self._has_happened() or self._is_at_level(stage) or (self.event.sign > 0 and self._monitor.verdict < 0)

    def _has_happened(self) -> bool:
        if self._monitor.verdict != self.event.sign:
            return False
        # Further agents or instances of a specification may begin, and must be satisfied as well.
        return self.event.sign < 0 or self._run.status is not None or self._is_final()

    def _is_at_level(self, stage: int) -> bool:
        levels = self.event.levels
        return stage < len(levels) and self._closeness() >= self.event.sign * levels[stage]

    def _closeness(self) -> float:
        """Return the present robustness, with the sign chosen such that it rises towards the event."""
        monitor = self._monitor
        begun = monitor.begun
        if not begun.any():
            return -math.inf
        if self.event.sign > 0:
            return float(monitor.lower[begun].min())
        return -float(monitor.upper[begun].min())

    def _is_final(self) -> bool:
        return self._monitor.begins and bool(self._monitor.begun.all())

    def _captured(self) -> SplitState:
        try:
            return capture(self._run, self._scenario, __version__)
        except StateError as error:
            raise SweepError(f"the run cannot be split: {error}") from error


@contextmanager
def split_run(built: Built, event: RareEvent) -> Iterator[SplitRun]:
    """Provide a run that can be split.

    Raises:
        SweepError: The run cannot be split; the message gives the reason.
        KeyboardInterrupt: A signal ended the run.
    """
    event.check(built)
    remote = [entry.path for entry in built.simulation.entries if entry.timing.in_process]
    if remote:
        raise SweepError(f"the run cannot be split: {remote[0]} computes in another process (`run_in: process`)")
    # The stages need bounds of the robustness, regardless of the scenario's options.
    specifications = [
        replace(each, interval=each.automaton is None) if each.name == event.specification else each
        for each in built.options.specifications
    ]
    options = replace(built.options, pace=None, specifications=specifications)
    digest = hashlib.sha256(built.resolved).hexdigest()
    with prepared(replace(built, options=options), None, may_exit=False) as run:
        yield SplitRun(run, event, digest)
