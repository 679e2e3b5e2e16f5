"""Many runs as one array program: they are advanced to their end together, and each has its own figures.

Reasons: docs/decisions/0032-batches.md
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from symaware_cli.core import seconds
from symaware_cli.engine import Run, RunSummary
from symaware_cli.language.build import Built
from symaware_cli.language.compose import Composition
from symaware_cli.specification import Outcome, outcome_of
from symaware_cli.studies.batch_ends import BatchEnds
from symaware_cli.studies.batch_observer import BatchObserver
from symaware_cli.studies.batch_simulation import BatchSimulation, Start
from symaware_cli.studies.measurement import Measurement


class Batch:
    """Runs of one scenario that differ in their seeds and, optionally, in their initial conditions."""

    def __init__(
        self,
        composition: Composition,
        built: Built,
        seeds: Sequence[int],
        starts: Sequence[Mapping[str, Start]] = (),
    ) -> None:
        """Prepare the runs.

        Arguments and errors are those of `BatchSimulation`.
        """
        self._seeds = tuple(seeds)
        batched = BatchSimulation(composition, built, seeds, starts)
        self.simulation = batched.simulation
        self.observer = BatchObserver(self.simulation)
        self.measurement = Measurement(self.simulation)
        self._ends: dict[int, dict[str, Any]] = {}
        until = built.options.until
        if until is not None:
            until = BatchEnds(until, self.simulation, self.observer, self._leave)
        options = replace(built.options, specifications=batched.specifications, until=until, may_exit=False)
        self.run = Run(self.simulation, built.steps, None, None, options, observer=self.observer)

    def advance(self) -> None:
        """Advance all runs to their end."""
        self.run.advance()

    def _leave(self, runs: Sequence[int]) -> None:
        """Record the end times of runs that are over, and stop observing them."""
        now = self.simulation.clock.now
        figures = {
            "steps": now // self.simulation.environment.time_step,
            "simulated_time": seconds(now),
            "turns": sum(each.turns for each in self.run.schedulers),
        }
        self._ends.update(dict.fromkeys(runs, figures))
        self.observer.going[runs] = False
        self.measurement.leave(runs)

    def summaries(self) -> list[RunSummary]:
        """Return the summary of each run; wall times are equal shares of the batch's, and outcomes carry no reasons."""
        whole, count = self.run.summary, len(self._seeds)
        outcomes = self._outcomes()
        return [
            replace(
                whole,
                seed=seed,
                agents=whole.agents // count,
                wall_time=whole.wall_time / count,
                contacts=int(self.observer.contacts_of[run]),
                minimum_separation=self.observer.separation_of(run),
                highest_risk=self.observer.risk_of(run),
                goals_reached=self.observer.goals_of(run),
                warnings=dict(sorted(self.observer.warnings_of(run).items())),
                errors=dict(sorted(self.observer.errors_of(run).items())),
                specifications=outcomes[run],
                **self._ends.get(run, {}),
            )
            for run, seed in enumerate(self._seeds)
        ]

    def _outcomes(self) -> list[tuple[Outcome, ...]]:
        """Return the outcomes of the specifications in each run."""
        found: list[list[Outcome]] = [[] for _ in self._seeds]
        for monitor in self.run.specification_monitors:
            specification = monitor.specification
            rows = specification.scope.rows // len(self._seeds)
            for run, outcomes in enumerate(found):
                own = slice(run * rows, (run + 1) * rows)
                outcomes.append(
                    outcome_of(
                        specification.name,
                        specification.text,
                        lambda row: (),
                        monitor.verdicts[own],
                        monitor.settled[own],
                        monitor.upper[own],
                        (),
                    )
                )
        return [tuple(each) for each in found]
