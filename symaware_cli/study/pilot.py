"""A pilot of splitting: chooses levels that a good part of the trials reach, each from the one before."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from symaware_cli.scenario.files import open_scenario
from symaware_cli.study.rare_event import SplitRun, split_run
from symaware_cli.study.repeats import SplittingPlan
from symaware_cli.world.chance import key_of

#: The share of trials that is to reach each level, and the most levels.
_SHARE, _MOST = 0.2, 100

#: How many significant digits levels have, so that they can be passed again as they are printed.
_DIGITS = 4


@dataclass(frozen=True, slots=True)
class Pilot:
    """What a pilot came to.

    Attributes:
        levels: The levels, as in `RareEvent`; none if a good part of the runs comes to the event without any, or if the
            specification has no robustness.
        steps: How many steps it took.
    """

    levels: tuple[float, ...]
    steps: int


def pilot(plan: SplittingPlan) -> Pilot:
    """Choose levels for a plan that has none.

    Trials are run to their ends, and the first level is what a fifth of them came to. From the states in which these
    reached it, further trials give the next level, until a fifth of the trials comes to the event.

    What is drawn is drawn apart from the repeats, so that their estimates stay unbiased.

    Source: F. Cérou, A. Guyader, "Adaptive Multilevel Splitting for Rare Event Analysis", Stochastic Analysis and
    Applications 25, 2007; with as many trials for each level as the plan has for each stage.

    Raises:
        ScenarioError: The scenario has problems.
        SweepError: It has no such event, or its runs cannot be split.
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
        # The same trials again, as far as the level.
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
    """The next level, with the sign by which the robustness rises towards the event; None if none is needed or found.

    Args:
        closest: How close each trial came; infinite if the event happened.
        before: The level before.
    """
    ordered = sorted(closest, reverse=True)
    wanted = ordered[math.ceil(_SHARE * len(ordered)) - 1]
    if wanted == math.inf:
        return None
    # If few came closer than the level before, what these came to.
    candidates = [wanted, *sorted(each for each in closest if wanted < each < math.inf)]
    found = (_rounded(each) for each in candidates if math.isfinite(each) and each < 0.0)
    return next((each for each in found if each > before), None)


def _rounded(closeness: float) -> float:
    """A number below 0 with few digits that is not closer to 0."""
    digits = _DIGITS - 1 - math.floor(math.log10(-closeness))
    return float(f"{math.floor(closeness * 10.0**digits) / 10.0**digits:.{_DIGITS}g}")


def _seed(plan: SplittingPlan, *place: int) -> int:
    return key_of(plan.seed, "pilot", *place) >> 1
