"""Multilevel splitting: the probability of a rare event as a product of larger probabilities, in independent repeats.

Reasons: docs/decisions/0049-rare-events.md
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.evidence.rare_event import RareEvent, SplitRun, split_run
from symaware_cli.language import open_scenario
from symaware_cli.studies import Block, IntervalEstimate, LostResultError, error_probability, seed_of, variance
from symaware_cli.world import generator, key_of

State = TypeVar("State")


class Process(Protocol[State]):
    """A random process that can be continued from its states."""

    def begin(self) -> State:
        """Return the initial state."""

    def reach(self, state: State, stage: int, seed: int) -> State | None:
        """Continue from a state to the end of a stage.

        Args:
            state: The state to continue from; it is not modified.
            stage: The stage, from 0 on; the last one ends with the event itself.
            seed: The seed of the random numbers of the trial.

        Returns:
            The state at the end of the stage; None if the process ended before.
        """


@dataclass(frozen=True, slots=True)
class StageCount:
    """The results of one stage in one repeat.

    Attributes:
        trials: The number of trials.
        reached: The number of trials that reached the end of the stage.
    """

    trials: int
    reached: int


def split(process: Process[State], stages: int, trials: int, seed: int) -> list[StageCount]:
    """Estimate the probability of an event in stages: trials that reach the end of one are split for the next.

    Every stage has the same number of trials. The trials of a stage continue from the end states of the previous stage
    in turn, in a random order that is drawn once, so that the numbers of uses of the states differ by at most one. The
    product of the shares of trials that reach the ends is an unbiased estimate of the probability of the event,
    regardless of where the stages end.

    Source: P. L'Ecuyer, F. Le Gland, P. Lezaud, B. Tuffin, "Splitting Techniques", in G. Rubino, B. Tuffin (editors),
    Rare Event Simulation using Monte Carlo Methods, Wiley 2009: fixed effort with fixed assignment.

    Args:
        process: The process.
        stages: The number of stages; the last one ends with the event.
        trials: The number of trials of each stage.
        seed: The seed, from which each trial's seed is derived with its stage and number.

    Returns:
        The results of the stages; fewer than `stages` if no trial reached the end of one.
    """
    states = [process.begin()]
    counts: list[StageCount] = []
    for stage in range(stages):
        order = generator(seed, f"splitting {stage}").permutation(len(states)).tolist()
        reached = []
        for trial in range(trials):
            start = states[order[trial % len(order)]]
            end = process.reach(start, stage, key_of(seed, "splitting", stage, trial) >> 1)
            if end is not None:
                reached.append(end)
        counts.append(StageCount(trials, len(reached)))
        states = reached
        if not states:
            break
    return counts


def product(counts: Sequence[StageCount], stages: int) -> float:
    """Return the estimate of one repeat: the product of the shares, 0 if it did not enter the last stage."""
    return math.prod(each.reached / each.trials for each in counts) if len(counts) == stages else 0.0


def mean_of_repeats(estimates: ArrayLike, confidence: float = 0.95) -> IntervalEstimate:
    """Estimate the probability from independent repeats: m exp(± t(1 - alpha / 2; n - 1) s / (m sqrt(n))).

    It is Student's interval for the logarithm of the mean, by the delta method, because estimates by splitting are
    skewed, and their logarithm less so. The interval is approximate (docs/evidence.md reports its coverage).

    Args:
        estimates: The estimate of each repeat; shape (n,).
        confidence: 1 - alpha.

    Returns:
        The mean with its interval; from 0 to 1 if there are fewer than two repeats or all estimates are 0.
    """
    from scipy.special import stdtrit

    method, alpha = "Student's t of the logarithm", error_probability(confidence)
    sample = np.asarray(estimates, float)
    count = len(sample)
    mean = math.fsum(sample) / count if count else math.nan
    if count < 2 or not mean > 0.0:
        return IntervalEstimate(mean, 0.0, 1.0, count, confidence, method)
    relative = math.sqrt(variance(sample) / count) / mean
    factor = math.exp(min(float(stdtrit(count - 1, 1.0 - alpha / 2)) * relative, 700.0))
    return IntervalEstimate(mean, mean / factor, min(mean * factor, 1.0), count, confidence, method)


@dataclass(frozen=True, slots=True)
class SplittingPlan:
    """The plan of all repeats.

    Attributes:
        scenario: The scenario, or a log of one.
        changes: The changes to the scenario, in the form of ``--set``.
        event: The event.
        trials: The number of trials of each stage.
        seed: The seed from which the seeds of the repeats are derived.
    """

    scenario: Path
    changes: tuple[str, ...]
    event: RareEvent
    trials: int
    seed: int

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return {**asdict(self), "scenario": str(self.scenario)}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        """Create an instance from the result of `to_json` after conversion to and from JSON."""
        event = RareEvent(**{**data["event"], "levels": tuple(data["event"]["levels"])})
        return cls(**{**data, "scenario": Path(data["scenario"]), "changes": tuple(data["changes"]), "event": event})


@dataclass(frozen=True, slots=True)
class Repeat:
    """The result of a repeat.

    Attributes:
        number: Its number, from 0 on.
        counts: The results of the stages; fewer than planned if no trial reached the end of one.
        estimate: The product of the shares.
        steps: The number of steps executed.
        failed: The number of trials in which a component failed; they do not reach the end of their stage.
        cpu_time: The CPU time spent [s].
    """

    number: int
    counts: Sequence[StageCount]
    estimate: float
    steps: int
    failed: int
    cpu_time: float

    @property
    def index(self) -> int:
        """Its number."""
        return self.number

    @property
    def wall_time(self) -> float:
        """The time that it took, measured as CPU time [s]."""
        return self.cpu_time

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        """Create an instance from the result of `to_json` after conversion to and from JSON."""
        return cls(**{**data, "counts": [StageCount(**each) for each in data["counts"]]})


def repeat(plan: SplittingPlan, number: int) -> Repeat:
    """Execute a repeat.

    Each repeat has its own seed of the scenario, so that initial values and everything else drawn before the first step
    differ between repeats; they are the same in all trials of a repeat.

    Raises:
        ScenarioError: The scenario is invalid.
        SweepError: The scenario has no such event, or its runs cannot be split.
        KeyboardInterrupt: A signal ended a run.
    """
    began = time.process_time()
    seed = seed_of(plan.seed, number)
    built = open_scenario(plan.scenario, plan.changes, seed)
    with split_run(built, plan.event) as run:
        counts = split(run, plan.event.stages, plan.trials, seed)
    estimate = product(counts, plan.event.stages)
    return Repeat(number, counts, estimate, run.steps, run.failed, time.process_time() - began)


def check(plan: SplittingPlan) -> None:
    """Check that repeats can begin, before they are given to workers.

    Raises:
        ScenarioError: See `repeat`.
        SweepError: See `repeat`.
        KeyboardInterrupt: See `repeat`.
    """
    with split_run(open_scenario(plan.scenario, plan.changes, seed_of(plan.seed, 0)), plan.event) as run:
        run.begin()


class RepeatWork:
    """`Work` that executes repeats."""

    def __init__(self, plan: SplittingPlan) -> None:
        """Prepare.

        Args:
            plan: The plan of all repeats.
        """
        self._plan = plan

    def open(self) -> None:
        """See `Work`."""

    def prepare(self) -> None:
        """See `Work`."""
        open_scenario(self._plan.scenario, self._plan.changes)

    def results(self, block: Block) -> Iterator[Repeat]:
        """See `Work`.

        Raises:
            ScenarioError: See `repeat`.
            SweepError: See `repeat`.
        """
        return (repeat(self._plan, number) for number in block.indices)

    def to_json(self) -> dict[str, Any]:
        """See `Work`."""
        return self._plan.to_json()

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> RepeatWork:
        """See `Work`."""
        return cls(SplittingPlan.from_json(content))

    def received(self, content: dict[str, Any]) -> Repeat:
        """See `Work`."""
        return Repeat.from_json(content)

    def lost(self, index: int, why: str) -> Repeat:
        """See `Work`; a mean without this repeat would be biased, so it cannot be replaced."""
        raise LostResultError(f"repeat {index} was lost: {why}")


#: The intended share of trials that reach each level, and the maximum number of levels.
_SHARE, _MOST = 0.2, 100

#: The number of significant digits of levels, so that printed levels can be passed back without loss.
_DIGITS = 4


@dataclass(frozen=True, slots=True)
class Pilot:
    """The result of a pilot.

    Attributes:
        levels: The levels, as in `RareEvent`; empty if many runs reach the event without any, or if the specification
            has no robustness.
        steps: The number of steps executed.
    """

    levels: tuple[float, ...]
    steps: int


def pilot(plan: SplittingPlan) -> Pilot:
    """Choose levels for a plan that has none.

    Trials are run to their ends, and the first level is the robustness that a fifth of them reach. Further trials from
    the states in which these reached the level give the next level, until a fifth of the trials reach the event.

    The random numbers are independent of those of the repeats, so that their estimates stay unbiased.

    Source: F. Cérou, A. Guyader, "Adaptive Multilevel Splitting for Rare Event Analysis", Stochastic Analysis and
    Applications 25, 2007; with as many trials for each level as the plan has for each stage.

    Raises:
        ScenarioError: The scenario is invalid.
        SweepError: The scenario has no such event, or its runs cannot be split.
        KeyboardInterrupt: A signal ended a run.
    """
    built = open_scenario(plan.scenario, plan.changes, _seed(plan))
    with split_run(built, plan.event) as run:
        return Pilot(_chosen(run, plan) if run.has_robustness else (), run.steps)


def _chosen(run: SplitRun, plan: SplittingPlan) -> tuple[float, ...]:
    event, states = run.event, [run.begin()]
    for stage in range(_MOST):
        levels = run.event.levels
        starts = [(states[trial % len(states)], _seed(plan, stage, trial)) for trial in range(plan.trials)]
        closest = [run.closest(state, seed) for state, seed in starts]
        level = _next(closest, event.sign * levels[-1] if levels else -math.inf)
        if level is None:
            break
        run.event = replace(event, levels=(*levels, event.sign * level))
        # The same trials are repeated up to the level.
        reached = [
            run.reach(state, stage, seed)
            for (state, seed), found in zip(starts, closest, strict=True)
            if found >= level
        ]
        states = [state for state in reached if state is not None]
        if not states:
            break
    return run.event.levels


def _next(closest: Sequence[float], before: float) -> float | None:
    """Return the next level, signed to rise towards the event; None if none is needed or found.

    Args:
        closest: The closest approach of each trial; infinite if the event happened.
        before: The previous level.
    """
    ordered = sorted(closest, reverse=True)
    wanted = ordered[math.ceil(_SHARE * len(ordered)) - 1]
    if wanted == math.inf:
        return None
    # If only few trials passed the previous level, the level that these reached.
    candidates = [wanted, *sorted(each for each in closest if wanted < each < math.inf)]
    found = (_rounded(each) for each in candidates if math.isfinite(each) and each < 0.0)
    return next((each for each in found if each > before), None)


def _rounded(closeness: float) -> float:
    """Round a negative number away from 0 to few digits."""
    digits = _DIGITS - 1 - math.floor(math.log10(-closeness))
    return float(f"{math.floor(closeness * 10.0**digits) / 10.0**digits:.{_DIGITS}g}")


def _seed(plan: SplittingPlan, *place: int) -> int:
    return key_of(plan.seed, "pilot", *place) >> 1
