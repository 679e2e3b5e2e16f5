"""Estimation of rare-event probabilities by splitting."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from symaware_cli.evidence.rare_event import EventKind, RareEvent
from symaware_cli.evidence.splitting import Pilot, Repeat, RepeatWork, SplittingPlan, check, mean_of_repeats, pilot
from symaware_cli.language import Changes, FilePath, assignments
from symaware_cli.studies import Blocks, IntervalEstimate, executor_of, signals_raised


@dataclass(frozen=True, slots=True)
class RareEventEstimate:
    """An estimate of the probability of a rare event by splitting; it certifies nothing.

    Attributes:
        plan: The plan of all repeats.
        repeats: The results of the repeats, by number.
        probability: The mean of the repeats with its confidence interval.
        pilot: The pilot that chose the levels; None if they were given.
    """

    plan: SplittingPlan
    repeats: Sequence[Repeat]
    probability: IntervalEstimate
    pilot: Pilot | None = None

    @property
    def shares(self) -> Sequence[float]:
        """The share of trials that reached the end of each stage, over all repeats that entered the stage."""
        shares = []
        for stage in range(self.plan.event.stages):
            there = [each.counts[stage] for each in self.repeats if stage < len(each.counts)]
            trials = sum(each.trials for each in there)
            shares.append(sum(each.reached for each in there) / trials if trials else 0.0)
        return shares

    @property
    def missed(self) -> int:
        """The number of repeats that never reached the event; their estimate is 0."""
        return sum(each.estimate == 0.0 for each in self.repeats)

    @property
    def failed(self) -> int:
        """The number of trials in which a component failed; they did not reach the end of their stage."""
        return sum(each.failed for each in self.repeats)

    @property
    def steps(self) -> int:
        """The number of steps of all repeats."""
        return sum(each.steps for each in self.repeats)

    @property
    def cpu_time(self) -> float:
        """The CPU time of all repeats [s], the only value that is not reproducible."""
        return sum(each.cpu_time for each in self.repeats)

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return {
            **self.plan.to_json(),
            "probability": asdict(self.probability),
            "pilot": None if self.pilot is None else asdict(self.pilot),
            "shares": list(self.shares),
            "missed": self.missed,
            "failed": self.failed,
            "steps": self.steps,
            "cpu_time": self.cpu_time,
            "repeats": [asdict(each) for each in self.repeats],
        }


def estimate(
    scenario: FilePath,
    specification: str,
    levels: Sequence[float] | None = None,
    *,
    event: EventKind = "violated",
    trials: int = 100,
    repeats: int = 20,
    changes: Changes | None = None,
    seed: int = 0,
    confidence: float = 0.95,
    jobs: int = 0,
    on_progress: Callable[[int, int], object] | None = None,
) -> RareEventEstimate:
    """Estimate the probability that a specification is violated, or satisfied, by splitting.

    Runs are continued, with new random numbers, from states in which earlier runs came closer to the event, because
    their robustness had reached a level. The probability is thus a product of probabilities that are not small.

    Args:
        scenario: A scenario, or a log of one. It must be possible to capture the state of its runs (docs/capture.md).
        specification: The name of the specification.
        levels: Levels of robustness on the way to the event, in the unit of the formula: descending and above 0 for a
            violation, ascending and below 0 otherwise. By default a pilot chooses them; empty to let all trials be
            plain runs.
        event: ``violated`` or ``satisfied``, over all agents or pairs that the specification applies to.
        trials: The number of trials of each stage of each repeat.
        repeats: The number of independent repeats, from which the interval is computed.
        changes: Changes to the scenario.
        seed: The seed of all random draws: the same seed gives the same estimate.
        confidence: The confidence of the interval.
        jobs: The number of worker processes; 0 to execute the repeats in this process. It does not affect the estimate.
        on_progress: Called after each repeat with the number of completed repeats and the total.

    Raises:
        ScenarioError: The scenario is invalid.
        SweepError: The scenario has no such event, the state of its runs cannot be captured, or a worker process died;
            the message gives the reason.
        ValueError: There are no trials, or fewer than two repeats.
        KeyboardInterrupt: A signal ended a run.
    """
    if trials < 1 or repeats < 2:
        raise ValueError(f"at least one trial and two repeats are needed, not {trials} and {repeats}")
    plan = SplittingPlan(
        Path(scenario),
        tuple(map(str, assignments(changes))),
        RareEvent(specification, event, tuple(levels or ())),
        trials,
        seed,
    )
    with signals_raised():
        piloted = None
        if levels is None:
            piloted = pilot(plan)
            plan = replace(plan, event=replace(plan.event, levels=piloted.levels))
        else:
            check(plan)
        made: list[Repeat] = []
        with executor_of(RepeatWork(plan), min(jobs, repeats)) as executor:
            for each in executor.results(Blocks(range(repeats), repeats)):
                made.append(each)
                if on_progress is not None:
                    on_progress(len(made), repeats)
    made.sort(key=lambda each: each.number)
    return RareEventEstimate(plan, made, mean_of_repeats([each.estimate for each in made], confidence), piloted)
