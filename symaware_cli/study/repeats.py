"""Independent repeats of splitting: each is one run of the scenario with a seed of its own, split again and again."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from symaware_cli.scenario.files import open_scenario
from symaware_cli.study.rare_event import RareEvent, split_run
from symaware_cli.study.seeds import seed_of
from symaware_cli.study.splitting import StageCount, product, split
from symaware_cli.study.sweep_error import SweepError
from symaware_cli.study.work import Block


@dataclass(frozen=True, slots=True)
class SplittingPlan:
    """What every repeat does.

    Attributes:
        scenario: The scenario, or a log of one.
        changes: What is changed in it, in the form of ``--set``.
        event: The event.
        trials: The number of trials of each stage.
        seed: What the seeds of the repeats are drawn from.
    """

    scenario: Path
    changes: tuple[str, ...]
    event: RareEvent
    trials: int
    seed: int

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {**asdict(self), "scenario": str(self.scenario)}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        """Create it from what `to_json` returned, after a way through JSON."""
        event = RareEvent(**{**data["event"], "levels": tuple(data["event"]["levels"])})
        return cls(**{**data, "scenario": Path(data["scenario"]), "changes": tuple(data["changes"]), "event": event})


@dataclass(frozen=True, slots=True)
class Repeat:
    """What came of a repeat.

    Attributes:
        number: Its number, from 0 on.
        counts: What became of each stage; fewer than there are if nothing reached the end of one.
        estimate: The product of the shares.
        steps: How many steps it took.
        failed: In how many trials a component failed; they do not reach the end of their stage.
        cpu_time: The CPU time that it took [s].
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
        """How long it took [s]."""
        return self.cpu_time

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        """Create it from what `to_json` returned, after a way through JSON."""
        return cls(**{**data, "counts": [StageCount(**each) for each in data["counts"]]})


def repeat(plan: SplittingPlan, number: int) -> Repeat:
    """Make a repeat.

    The scenario gets a seed of its own, so that initial values that are drawn, and whatever else is drawn before the
    first step, differ from repeat to repeat; they are the same in all trials of one.

    Raises:
        ScenarioError: The scenario has problems.
        SweepError: It has no such event, or its runs cannot be split.
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
    """Make sure that repeats can begin, before somebody is asked for them.

    Raises:
        ScenarioError: See `repeat`.
        SweepError: See `repeat`.
        KeyboardInterrupt: See `repeat`.
    """
    with split_run(open_scenario(plan.scenario, plan.changes, seed_of(plan.seed, 0)), plan.event) as run:
        run.begin()


class RepeatWork:
    """`Work` that makes repeats."""

    def __init__(self, plan: SplittingPlan) -> None:
        """Prepare.

        Args:
            plan: What each does.
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
        return {"kind": "repeats", "plan": self._plan.to_json()}

    def received(self, content: dict[str, Any]) -> Repeat:
        """See `Work`."""
        return Repeat.from_json(content)

    def lost(self, index: int, why: str) -> Repeat:
        """See `Work`; without it the mean would be that of the repeats that happened to end."""
        raise SweepError(f"repeat {index} was lost: {why}")
