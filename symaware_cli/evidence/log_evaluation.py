"""Independent evaluation of the specifications of a log, without the monitors that ran with the simulation.

Predicates are computed from the recorded states; the operators above them are evaluated by their definitions, over all
samples at once, after the whole log has been read.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Event
from symaware_cli.engine import STATUS_NAMES, Trigger, rows_begun
from symaware_cli.evidence.recorded_names import RecordedNames
from symaware_cli.evidence.recorded_run import RecordedSpecifications
from symaware_cli.evidence.semantics import robustness_interval
from symaware_cli.language import Catalogue
from symaware_cli.specification import REJECTED, VERDICTS, Specification
from symaware_cli.specification.formula import Array, plain
from symaware_cli.specification.node import Name, walk

#: Verdicts, the worst first.
_ORDER = list(VERDICTS.values())


class RowValue(NamedTuple):
    """The verdict and robustness of a specification for an agent, a pair, or the world."""

    agents: tuple[str, ...]
    verdict: str
    robustness: float


@dataclass(frozen=True, slots=True)
class EvaluatedSpecification:
    """The outcome of a specification, by its definition.

    Attributes:
        name: Its name.
        rows: The values of each agent or pair that it was ever evaluated for.
        is_exact: Whether the robustness of each row is that of the run. Otherwise the run may have only an upper bound,
            because it stops evaluating an instance once its verdict is known.
        is_rejected: Whether it was offered, and no agent accepted it.
    """

    name: str
    rows: Sequence[RowValue]
    is_exact: bool
    is_rejected: bool = False

    @property
    def verdict(self) -> str:
        """The worst verdict; undecided if it was never evaluated for any row."""
        if self.is_rejected:
            return REJECTED
        return min((row.verdict for row in self.rows), key=_ORDER.index, default="undecided")

    @property
    def robustness(self) -> float | None:
        """The least robustness; None if unknown or infinite."""
        least = min((row.robustness for row in self.rows), default=np.inf)
        return float(least) if np.isfinite(least) else None


class LogEvaluation(NamedTuple):
    """The outcomes of the specifications of a log.

    Attributes:
        specifications: The evaluated specifications.
        left_out: The reason why each other specification was not evaluated, by name.
        is_complete: Whether the log contains all data that specifications need, so that monitors can evaluate the
            others.
    """

    specifications: Sequence[EvaluatedSpecification]
    left_out: Mapping[str, str]
    is_complete: bool


def evaluate_log(path: Path, catalogue: Catalogue | None = None) -> LogEvaluation:
    """Evaluate the specifications of the log of a run that reached its end.

    Args:
        path: The log.
        catalogue: The installed plugins, if already listed.

    Raises:
        LogError: The log cannot be read.
        ScenarioError: The scenario of the log is invalid.
        SpecificationError: A specification has no value.
    """
    recorded = RecordedSpecifications(path, catalogue=catalogue)
    triggers = recorded.options.instances
    reasons = {each.name: _reason(recorded, each, triggers.get(each.name)) for each in recorded.specifications}
    names = RecordedNames(recorded.simulation)
    followed = [
        _Samples(each, triggers.get(each.name), recorded, names)
        for each in recorded.specifications
        if not reasons[each.name]
    ]
    with np.errstate(all="ignore"):
        for now in recorded.instants() if followed else ():
            for each in followed:
                each.look(now)
        evaluated = [each.evaluated() for each in followed]
    is_complete = recorded.period == recorded.step and not any(map(recorded.missing, recorded.specifications))
    return LogEvaluation(evaluated, {name: reason for name, reason in reasons.items() if reason}, is_complete)


def _reason(recorded: RecordedSpecifications, specification: Specification, trigger: Trigger | None) -> str:
    """Return why a specification cannot be evaluated; empty if it can."""
    names = {node.name for node in walk(specification.formulation.tree) if isinstance(node, Name)}
    if names & {*STATUS_NAMES} or (trigger is not None and trigger.event in ("violated", "satisfied")):
        return "it refers to the verdicts of monitors"
    if recorded.period != recorded.step:
        return "the log does not contain every step"
    if missing := recorded.missing(specification):
        return f"the log does not contain {', '.join(missing)}"
    return ""


class _Samples:
    """The values of the predicates of a specification, and the spans over which each row is evaluated."""

    def __init__(
        self,
        specification: Specification,
        trigger: Trigger | None,
        recorded: RecordedSpecifications,
        names: RecordedNames,
    ) -> None:
        self._specification = specification
        self._names = names
        self._trigger = trigger if specification.offer is None else None
        self._values: list[list[Array]] = []
        #: The evaluations of each row: their first instant, and the instant after their last.
        self._spans: dict[int, list[list[int]]] = defaultdict(list)
        offer = specification.offer
        #: Whether evaluation begins with an event instead of automatically.
        self._is_begun = trigger is not None or offer is not None
        self._due: list[int] = [] if self._is_begun else list(range(specification.scope.rows))
        #: For an offered specification: the agent that accepted it, and whether it was rejected.
        self._holder: str | None = None
        self._is_rejected = False
        if offer is not None:
            for event in ("offered", "accepted", "released", "rejected"):
                recorded.router.connect(event, f"specifications.{specification.name}", self._on_offer)
        elif trigger is not None:
            recorded.router.connect(
                trigger.event, trigger.source, partial(self._begin, trigger, recorded.simulation.groups)
            )

    def _begin(self, trigger: Trigger, groups: Sequence[AgentGroup], event: Event) -> None:
        """Begin an instance for an event that triggers it."""
        self._due += rows_begun(event, trigger, self._specification, groups)

    def _on_offer(self, event: Event) -> None:
        """Begin the evaluation for all agents when the specification is offered, and keep track of its holder."""
        match event.name:
            case "offered":
                self._due += range(self._specification.scope.rows)
            case "accepted":
                self._holder = str(event.data["agent"])
            case "released":
                self._holder = None
            case "rejected":
                self._is_rejected = True

    def look(self, now: int) -> None:
        """Record the values at an instant."""
        specification = self._specification
        scope = specification.scope
        if now < specification.start or (specification.end is not None and now > specification.end):
            return
        present = np.ones(scope.rows, bool) if scope.present is None else scope.present
        number = len(self._values)
        for row, spans in self._spans.items():
            if not present[row]:
                for span in spans:
                    span[1] = min(span[1], number)
        for row in sorted({*self._due}):  # several events since the last step would begin equal instances
            if present[row]:
                self._spans[row].append([number, np.iinfo(int).max])
        # Evaluations triggered by an event begin at once or never; all others begin when their agents are present.
        self._due = [] if self._is_begun else [row for row in self._due if not present[row]]
        self._values.append(self._names.robustness(specification))

    def evaluated(self) -> EvaluatedSpecification:
        """Evaluate the specification on all recorded values."""
        specification = self._specification
        found: dict[int, list[tuple[float, float, bool]]] = defaultdict(list)
        for (first, end), rows in self._by_span().items():
            instants = min(end, len(self._values)) - first
            samples = [
                np.array([values[atom][rows] for values in self._values[first:end]])
                for atom in range(len(specification.formulation.atoms))
            ]
            low, high = robustness_interval(
                specification.formulation.formula,
                samples,
                instants,
                len(rows),
                ended=True,
                cut=specification.automaton is not None,
                times=1,
            )
            # Values beyond the horizon do not count; without a horizon, the evaluation extends to the end of the run.
            horizon = specification.formulation.horizon
            for place, row in enumerate(rows.tolist()):
                pair = low[0, place], high[0, place]
                found[row].append((*pair, pair[0] == pair[1] if horizon is None else instants > horizon))
        rows_found = [self._row(row, found[row]) for row in sorted(found)]
        if specification.offer is not None:
            rows_found = [each for each in rows_found if each.agents == (self._holder,)]
        return EvaluatedSpecification(specification.name, rows_found, self._trigger is None, self._is_rejected)

    def _by_span(self) -> Mapping[tuple[int, int], NDArray[np.intp]]:
        of_spans: dict[tuple[int, int], list[int]] = defaultdict(list)
        for row, spans in self._spans.items():
            for first, end in spans:
                of_spans[first, end].append(row)
        return {span: np.array(rows, np.intp) for span, rows in of_spans.items()}

    def _row(self, row: int, instances: Sequence[tuple[float, float, bool]]) -> RowValue:
        """Return the worst of the instances of a row, given the bounds of each and whether its robustness is exact."""
        specification = self._specification
        verdict = min(1 if low > 0.0 else -1 if high < 0.0 else 0 for low, high, _ in instances)
        robustness = min(float(plain(np.asarray(high))) for _, high, _ in instances)
        if specification.automaton is not None or (
            not specification.interval and not all(is_exact for _, _, is_exact in instances)
        ):
            robustness = np.inf  # the run has no robustness
        return RowValue(specification.scope.agents(row), VERDICTS[verdict], robustness)
