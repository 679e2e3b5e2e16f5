"""Stopping rules for a sequence of runs, such as ``halfwidth(satisfied.safe) < 0.01 and runs >= 100``.

A rule is evaluated on the runs with indices 0 to n - 1, only at declared numbers n, so neither the order in which runs
end nor the number of workers affects the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from symaware_cli.specification.columns import FUNCTIONS, Function, Functions
from symaware_cli.specification.expression import Expression, ExpressionError
from symaware_cli.specification.node import Call, Comparison, Element, Junction, Name, Node, Not, Span, walk
from symaware_cli.studies.statistics.confidence_sequence import BetaMixture, ConfidenceSequence, EmpiricalBernstein
from symaware_cli.studies.statistics.interval_estimate import IntervalEstimate, error_probability


@dataclass(frozen=True, slots=True)
class Looks:
    """A schedule of looks, declared before the first run.

    After a look at n runs, the next is at max(n + step, ceil(ratio n)) runs, and the first at `step`: a ratio of 1
    gives a look every `step` runs; a greater ratio gives a geometric schedule, with few looks for many runs.

    Attributes:
        step: The least number of runs between two looks, and before the first.
        ratio: The least ratio of the numbers of runs of two looks, at least 1.
    """

    step: int = 20
    ratio: float = 1.0

    def __post_init__(self) -> None:
        if self.step < 1:
            raise ValueError(f"there is at least 1 run between two looks, not {self.step}")
        if not (math.isfinite(self.ratio) and self.ratio >= 1.0):
            raise ValueError(f"the ratio of a geometric schedule is at least 1, not {self.ratio:g}")

    def after(self, count: int) -> int:
        """Return the number of runs at the next look after a look at `count` runs; 0 gives the first look."""
        return max(count + self.step, math.ceil(self.ratio * count))

    def __iter__(self) -> Iterator[int]:
        count = 0
        while True:
            count = self.after(count)
            yield count


#: The name of the number of runs in a rule.
_RUNS = "runs"


@dataclass(frozen=True, slots=True)
class Share:
    """The share of runs with a property; their values are 0 and 1."""

    def sequence(self, confidence: float) -> ConfidenceSequence:
        """Return a new confidence sequence, without values."""
        return BetaMixture(confidence)


@dataclass(frozen=True, slots=True)
class Mean:
    """The mean of a metric.

    Attributes:
        low: The lower bound of the values, in the metric's unit; None if unknown.
        high: The upper bound of the values, likewise.
    """

    low: float | None = None
    high: float | None = None

    def sequence(self, confidence: float) -> ConfidenceSequence:
        """Return a new confidence sequence, without values.

        Raises:
            ValueError: A bound is missing, or the bounds are not in order.
        """
        if self.low is None or self.high is None:
            raise ValueError("a mean has an interval that may be watched only if bounds of its values are declared")
        return EmpiricalBernstein(self.low, self.high, confidence)


#: The estimands that a rule may refer to, by dotted names such as "satisfied.safe" or "mean.closest".
Estimands = Mapping[str, Share | Mean]

_INTERVAL: Mapping[str, Callable[[IntervalEstimate], float]] = {
    "estimate": lambda found: found.value,
    "halfwidth": lambda found: found.halfwidth,
    "lower": lambda found: found.lower,
    "upper": lambda found: found.upper,
}
_FUNCTIONS: Functions = {
    **{name: FUNCTIONS[name] for name in ("abs", "max", "min", "sqrt")},
    **{name: Function(1, function) for name, function in _INTERVAL.items()},
}


class StoppingRule:
    """A stopping rule, checked against the available estimands.

    Attributes:
        text: The rule as written.
        estimands: The estimands that it refers to, by dotted name, sorted.
        confidence: The confidence of each interval separately; several of them do not hold jointly with that
            confidence.
        looks: The numbers of runs at which it is evaluated.
    """

    def __init__(self, text: str, estimands: Estimands, confidence: float = 0.95, looks: Looks | None = None) -> None:
        """Parse a rule.

        Args:
            text: The rule as written: a condition on `runs` and on estimate(...), lower(...), upper(...) and
                halfwidth(...) of an estimand.
            estimands: The estimands that it may refer to.
            confidence: The confidence of each interval.
            looks: The numbers of runs at which it is evaluated.

        Raises:
            ExpressionError: The text is not a valid rule; the error locates the fault.
            ValueError: The confidence is not between 0 and 1.
        """
        error_probability(confidence)
        self.text = text
        self.confidence = confidence
        self.looks = looks or Looks()
        families = sorted({name.partition(".")[0] for name in estimands})
        self._expression = Expression(text, [*families, _RUNS], _FUNCTIONS)
        _require_condition(self._expression.tree)
        asked = sorted(set(_asked(self._expression.tree, estimands)))
        self.estimands: Estimands = MappingProxyType({name: estimands[name] for name in asked})

    def holds(self, runs: int, estimates: Mapping[str, IntervalEstimate]) -> bool:
        """Evaluate the rule.

        Args:
            runs: The number of runs.
            estimates: The estimates by the names of its estimands.

        Raises:
            EvaluationError: The rule has no value, such as after a division by zero.
        """
        tables: dict[str, Any] = {_RUNS: runs}
        for name, found in estimates.items():
            family, _, key = name.partition(".")
            if key:
                tables.setdefault(family, {})[key] = found
            else:
                tables[family] = found
        return self._expression.holds(tables.__getitem__)

    def begin(self) -> StoppingState:
        """Return the state of a sequence of runs before the first run."""
        return StoppingState(self)


class StoppingState:
    """The state of a stopping rule for a sequence of runs, which may arrive in any order.

    Attributes:
        rule: The rule.
        prefix: The number of known runs before the first gap, with indices 0 to prefix - 1.
        looked_at: The number of runs at the last look; 0 before the first.
        stopped_at: The final number of runs; None while the rule does not hold. Runs with this or a greater index are
            not part of the result.
    """

    def __init__(self, rule: StoppingRule) -> None:
        """Begin before the first run."""
        self.rule = rule
        self.prefix = 0
        self.looked_at = 0
        self.stopped_at: int | None = None
        self._sequences = {name: each.sequence(rule.confidence) for name, each in rule.estimands.items()}
        self._next = rule.looks.after(0)
        # The values of runs that no look has used yet, by index.
        self._waiting: dict[int, Mapping[str, float]] = {}

    def add(self, index: int, values: Mapping[str, float]) -> bool:
        """Add the values of a finished run.

        Args:
            index: The index of the run.
            values: The value of each estimand of the rule, by name: 0 or 1 for a share. Missing and NaN values are left
                out, and the estimand then refers to the runs that have a value. Other names are ignored.

        Returns:
            Whether the runs may stop.

        Raises:
            ValueError: The run was added before, or a value is outside the bounds of its estimand.
            EvaluationError: The rule has no value at a look.
        """
        if index < self.looked_at or index in self._waiting:
            raise ValueError(f"run {index} was already there")
        if self.stopped_at is not None:
            return True
        for name, sequence in self._sequences.items():
            value = values.get(name, np.nan)
            if value == value and not sequence.low <= value <= sequence.high:
                raise ValueError(
                    f"the value {value:g} of `{name}` in run {index} is outside the bounds {sequence.low:g} and "
                    f"{sequence.high:g} that were declared"
                )
        self._waiting[index] = values
        while self.prefix in self._waiting:
            self.prefix += 1
            if self.prefix == self._next and self._look():
                self._waiting.clear()
                self.stopped_at = self.prefix
                return True
        return False

    def keeps(self, index: int) -> bool:
        """Return whether a run is part of the result, according to the runs so far."""
        return self.stopped_at is None or index < self.stopped_at

    def estimates(self) -> dict[str, IntervalEstimate]:
        """Return the estimate of each estimand of the rule at the last look."""
        return {name: sequence.estimate() for name, sequence in self._sequences.items()}

    def _look(self) -> bool:
        rows = [self._waiting.pop(index) for index in range(self.looked_at, self.prefix)]
        for name, sequence in self._sequences.items():
            values = np.array([row.get(name, np.nan) for row in rows], float)
            sequence.update(values[~np.isnan(values)])
        self.looked_at, self._next = self.prefix, self.rule.looks.after(self.prefix)
        return self.rule.holds(self.prefix, self.estimates())


def _require_condition(tree: Node) -> None:
    match tree:
        case Comparison():
            return
        case Junction(operands=operands):
            for each in operands:
                _require_condition(each)
        case Not(operand=operand):
            _require_condition(operand)
        case _:
            said = "a stopping rule is made of comparisons, such as halfwidth(satisfied.safe) < 0.01"
            raise ExpressionError(said, tree.span)


def _asked(tree: Node, estimands: Estimands) -> list[str]:
    """Return the names of the estimands that a rule refers to.

    Raises:
        ExpressionError: An estimand does not exist, has no interval, or is not the argument of one of the functions.
    """
    found: list[str] = []
    known: set[int] = set()
    for node in walk(tree):
        if isinstance(node, Call) and node.function in _INTERVAL:
            (argument,) = node.arguments
            name = _dotted(argument)
            if name is None or name == _RUNS:
                example = _written(min(estimands, default="satisfied.safe"))
                said = f"{node.function}(...) takes an estimand, such as {example}"
                raise ExpressionError(said, argument.span)
            _require_interval(name, argument.span, estimands)
            found.append(name)
            known.update(id(each) for each in walk(argument))
        elif isinstance(node, Element | Name) and id(node) not in known and node != Name((0, 0), _RUNS):
            name = _dotted(node)
            if name is not None and name in estimands:
                asking = " or ".join(f"{function}({_written(name)})" for function in sorted(_INTERVAL))
                raise ExpressionError(f"this is an estimand: ask for {asking}", node.span)
            raise _unknown(name or "", node.span, estimands)
    return found


def _require_interval(name: str, span: Span, estimands: Estimands) -> None:
    if name not in estimands:
        raise _unknown(name, span, estimands)
    try:
        estimands[name].sequence(0.95)
    except ValueError as error:
        raise ExpressionError(f"`{name}`: {error}", span) from None


def _dotted(node: Node) -> str | None:
    """Return the name of an estimand, of one word or of two joined by a dot; None for other expressions."""
    match node:
        case Name(name=name):
            return name
        case Element(operand=Name(name=name), key=str(key)):
            return f"{name}.{key}"
    return None


def _written(name: str) -> str:
    """Return the name of an estimand as written in a rule."""
    family, _, key = name.partition(".")
    return name if not key or key.isidentifier() else f'{family}["{key}"]'


def _unknown(name: str, span: Span, estimands: Estimands) -> ExpressionError:
    said = f"there is no `{name}` to estimate" if name else "this is no estimand"
    return ExpressionError(said, span, name, [_written(each) for each in estimands])
