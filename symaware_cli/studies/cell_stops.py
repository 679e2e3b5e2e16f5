"""Stopping of a sweep: its rule is applied to the runs of each cell separately.

A rule sees the runs of a cell from the first up to the first gap. A lost run is a gap: its result is unknown, so no
rule uses later runs until it is repeated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from symaware_cli.language import Problem, ScenarioError, nearest
from symaware_cli.specification import ExpressionError
from symaware_cli.specification.expression import EvaluationError
from symaware_cli.studies.claim import ClaimProgress
from symaware_cli.studies.metrics import NUMERIC
from symaware_cli.studies.row import Row
from symaware_cli.studies.statistics.interval_estimate import IntervalEstimate
from symaware_cli.studies.statistics.stopping import Mean, Share, StoppingRule, StoppingState
from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.sweep_plan import SweepPlan


class CellStops:
    """The runs that a sweep still needs.

    Attributes:
        claims: The progress of the plan's claim in each cell; empty without a claim.
    """

    def __init__(self, plan: SweepPlan, specifications: Sequence[str]) -> None:
        """Begin before the first run.

        Args:
            plan: The plan, whose rule has been checked.
            specifications: The names of the specifications.
        """
        self._plan = plan
        self._specifications = specifications
        rule = rule_of(plan, specifications)
        self._states = [rule.begin() for _ in plan.cells] if rule else []
        claim = plan.document.claimed
        self.claims = [ClaimProgress(claim, len(plan.cells)) for _ in plan.cells] if claim else []
        self._text = plan.document.until or plan.document.claim

    def add(self, row: Row) -> None:
        """Add a row.

        Raises:
            SweepError: A metric is outside its declared bounds, or the rule has no value.
        """
        cell = self._plan.cell(row.index).number
        if self.claims:
            self.claims[cell].add(self._plan.replicate(row.index), row)
        if not self._states or row.state == "lost":
            return
        try:
            self._states[cell].add(self._plan.replicate(row.index), _values(row, self._specifications))
        except (ValueError, EvaluationError) as error:
            raise SweepError(f"run {row.index}: {error}") from error

    def wants(self, index: int) -> bool:
        """Return whether a run belongs to the result, according to the rows so far."""
        if self.claims:
            return self.claims[self._plan.cell(index).number].keeps(self._plan.replicate(index))
        if not self._states:
            return True
        return self._states[self._plan.cell(index).number].keeps(self._plan.replicate(index))

    @property
    def planned(self) -> int:
        """The number of runs that belong to the result, according to the rows so far."""
        runs = self._plan.document.runs
        states: Sequence[ClaimProgress | StoppingState] = self.claims or self._states
        if not states:
            return self._plan.count
        return sum(runs if state.stopped_at is None else state.stopped_at for state in states)

    @property
    def reason(self) -> str | None:
        """The rule or claim by which runs were left out; None if none were."""
        return self._text if self.planned < self._plan.count else None

    def estimates(self) -> Mapping[str, IntervalEstimate]:
        """Return the rule's estimates, with anytime-valid intervals; empty unless there is exactly one cell."""
        return self._states[0].estimates() if len(self._states) == 1 else {}


def rule_of(plan: SweepPlan, specifications: Sequence[str]) -> StoppingRule | None:
    """Return the rule of a plan; without one, a rule that never holds but provides estimates to watch.

    Raises:
        ExpressionError: The rule is invalid.
    """
    document = plan.document
    shares = {f"{verdict}.{name}": Share() for name in specifications for verdict in ("satisfied", "violated")}
    metrics = [*(each.name for each in NUMERIC), *document.metrics]
    means = {f"mean.{name}": Mean(*document.bounds.get(name, (None, None))) for name in metrics}
    text = document.until
    if text is None:
        if len(plan.cells) > 1 or not specifications or not document.is_independent:
            return None
        text = f'halfwidth(satisfied["{specifications[0]}"]) < 0'
    return StoppingRule(text, {**shares, **means}, document.confidence)


def check_rule(plan: SweepPlan, specifications: Sequence[str], problem: Problem) -> None:
    """Make sure that the rule of a plan is valid.

    Args:
        plan: The plan.
        specifications: The names of the specifications.
        problem: A problem located at the rule as a whole.

    Raises:
        ScenarioError: The rule is invalid.
    """
    try:
        rule_of(plan, specifications)
    except ExpressionError as error:
        span = problem.span
        line = problem.source_line or ""
        if span is not None and plan.document.until is not None:
            shift = line.find(plan.document.until)  # possibly after a quotation mark
            if shift >= 0:
                span = replace(
                    span, column=shift + error.start + 1, end_column=shift + max(error.end, error.start + 1) + 1
                )
        suggestion = nearest(error.name, error.names) if error.name else None
        raise ScenarioError([replace(problem, message=error.problem, span=span, suggestion=suggestion)]) from None


def _values(row: Row, specifications: Sequence[str]) -> dict[str, float]:
    """Return the value of each estimand in a run; a failed run satisfies no specification and has no metrics."""
    found = {}
    for name in specifications:
        verdict = row.verdicts.get(name)
        found[f"satisfied.{name}"] = float(verdict == "satisfied")
        found[f"violated.{name}"] = float(verdict == "violated")
    for name, value in row.metrics.items():
        if isinstance(value, int | float):
            found[f"mean.{name}"] = float(value)
    return found
