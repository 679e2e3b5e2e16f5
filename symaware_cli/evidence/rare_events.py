"""Estimates how probable a rare event is, by splitting."""

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
    """How probable a rare event is, by splitting. It is an estimate: nothing is certified by it.

    Attributes:
        plan: What every repeat did.
        repeats: What came of each, by its number.
        probability: The mean of the repeats with its interval.
        pilot: What chose the levels; None if they were given.
    """

    plan: SplittingPlan
    repeats: Sequence[Repeat]
    probability: IntervalEstimate
    pilot: Pilot | None = None

    @property
    def shares(self) -> Sequence[float]:
        """The share of trials that reached the end of each stage, of all repeats that came to the stage."""
        shares = []
        for stage in range(self.plan.event.stages):
            there = [each.counts[stage] for each in self.repeats if stage < len(each.counts)]
            trials = sum(each.trials for each in there)
            shares.append(sum(each.reached for each in there) / trials if trials else 0.0)
        return shares

    @property
    def missed(self) -> int:
        """How many repeats never came to the event; their estimate is 0."""
        return sum(each.estimate == 0.0 for each in self.repeats)

    @property
    def failed(self) -> int:
        """In how many trials a component failed; they did not reach the end of their stage."""
        return sum(each.failed for each in self.repeats)

    @property
    def steps(self) -> int:
        """How many steps all repeats took."""
        return sum(each.steps for each in self.repeats)

    @property
    def cpu_time(self) -> float:
        """The CPU time that all repeats took [s]; the only figure that differs when they are made again."""
        return sum(each.cpu_time for each in self.repeats)

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
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
    """Estimate how probable it is that a specification is violated, or satisfied, by splitting.

    Runs are continued from where earlier ones came closer to the event: from states in which the robustness had reached
    a level, with other draws from there on. So the probability is a product of probabilities that are not small.

    Args:
        scenario: A scenario, or a log of one. The state of its runs must be one that can be captured (docs/capture.md).
        specification: The name of the specification.
        levels: Robustness on the way to the event, in the unit of the formula: descending and above 0 to a violation,
            ascending and below 0 otherwise. By default a pilot chooses them; empty to let all trials be plain runs.
        event: ``violated`` or ``satisfied``, of all agents or pairs that the specification is about.
        trials: The number of trials of each stage of each repeat.
        repeats: The number of independent repeats, from which the interval is made.
        changes: Values of the scenario to change.
        seed: The seed of all random draws: the same seed gives the same estimate.
        confidence: The confidence of the interval.
        jobs: How many worker processes make the repeats; 0 to make them in this process. The figures are the same.
        on_progress: Called after each repeat with how many were made, and how many there are.

    Raises:
        ScenarioError: The scenario has problems.
        SweepError: It has no such event, the state of its runs cannot be captured, or a worker process died; the
            message says what.
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
