"""Custom metrics of a sweep: reductions of expressions over time, and metrics of plugins."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from symaware_cli.core import Metric
from symaware_cli.engine import Observer, Simulation, WorldScope, world_names
from symaware_cli.entry_points import PluginError
from symaware_cli.language import Catalogue, Problem, nearest, quoted
from symaware_cli.language.build import Built
from symaware_cli.specification import AbsentError
from symaware_cli.specification.expression import Expression, ExpressionError
from symaware_cli.studies.metrics import MetricDescription
from symaware_cli.studies.sweep_document import MetricUse, SweepDocument

_REDUCED = re.compile(r"\s*([a-z]+)\s*\((.*)\)\s*", re.DOTALL)

#: Reductions of a series to one number: functions of the result so far (None at first), the present value, and the
#: number of values before it.
_REDUCTIONS: Mapping[str, Callable[[float | None, float, int], float]] = {
    "final": lambda before, value, count: value,
    "initial": lambda before, value, count: value if before is None else before,
    "max": lambda before, value, count: value if before is None else max(before, value),
    "mean": lambda before, value, count: value if before is None else before + (value - before) / (count + 1),
    "min": lambda before, value, count: value if before is None else min(before, value),
}


_TYPES: Mapping[str, tuple[type, ...]] = {
    "number": (float, int),
    "integer": (int,),
    "truth": (bool,),
    "text": (str,),
}


class Follower(Protocol):
    """Computes one metric while a run proceeds."""

    def look(self, now: int) -> None:
        """Update the metric with the world at a step."""

    def value(self) -> Any:
        """Return the value at the end of the run."""


class ReducedSeries:
    """The greatest, least, mean, first or last value of an expression over the steps of a run."""

    def __init__(self, text: str, simulation: Simulation, specifications: Collection[str] | None = None) -> None:
        """Follow a run.

        Args:
            text: The reduction, such as ``max(highest_risk)``, of an expression with the same names as in
                ``run.until``.
            simulation: The simulation.
            specifications: The names of its specifications; None to accept any name in the text.

        Raises:
            ExpressionError: The text is invalid; the error locates the fault.
        """
        found = _REDUCED.fullmatch(text)
        if found is None or found[1] not in _REDUCTIONS:
            raise ExpressionError(f"a series is reduced by {', '.join(_REDUCTIONS)}: max(highest_risk)", (0, len(text)))
        regions = simulation.groups[0].regions if simulation.groups else {}
        names = world_names(simulation.groups, regions, simulation.environment.obstacles, specifications)
        try:
            self._expression = Expression(found[2], names)
        except ExpressionError as error:
            place = (error.start + found.start(2), error.end + found.start(2))
            raise ExpressionError(error.problem, place, error.name, error.names, error.correction) from None
        self._reduce = _REDUCTIONS[found[1]]
        self._simulation = simulation
        self._scope: WorldScope | None = None
        self._count = 0
        self._value: float | None = None

    def look(self, now: int) -> None:
        """Update the result with the value at a step; of several values, the greatest for `max`, the least for `min`.

        Steps at which an agent named by the expression is absent are skipped.

        Raises:
            EvaluationError: The expression has no value.
            ValueError: The value is not a number.
        """
        if self._scope is None:
            self._scope = WorldScope(self._simulation, Observer(self._simulation))
        try:
            found = np.asarray(self._expression.value(self._scope.look_up), float).ravel()
        except AbsentError:
            return
        if len(found) > 1 and self._reduce in (_REDUCTIONS["max"], _REDUCTIONS["min"]):
            found = found[[int(found.argmax() if self._reduce is _REDUCTIONS["max"] else found.argmin())]]
        if len(found) != 1:
            raise ValueError(f"`{self._expression.text}` has {len(found)} values, not one")
        self._value = self._reduce(self._value, float(found[0]), self._count)
        self._count += 1

    def value(self) -> float | None:
        """Return the reduced value; None without any step."""
        return self._value


class Followers:
    """The followers of a run, which are updated at each step and once more at its end.

    Attributes:
        by_name: The followers by the names of their metrics.
    """

    def __init__(self, by_name: Mapping[str, Follower], simulation: Simulation) -> None:
        self.by_name = by_name
        self._clock = simulation.clock
        if by_name:
            simulation.events.subscribe("stepping", lambda event: self.look())

    def look(self) -> None:
        """Update all followers with the present world."""
        for follower in self.by_name.values():
            follower.look(self._clock.now)


class CustomMetrics:
    """The custom metrics of a sweep."""

    def __init__(self, document: SweepDocument, catalogue: Catalogue) -> None:
        self._uses = document.metrics
        self._catalogue = catalogue

    def descriptions(self) -> list[MetricDescription]:
        """Return the description of each metric.

        Raises:
            PluginError: A plugin cannot be used.
        """
        return [self._description(name, use) for name, use in self._uses.items()]

    def followers(self, simulation: Simulation) -> Followers:
        """Attach a follower of each metric to a run that is about to begin.

        Raises:
            PluginError: A plugin cannot be used.
            ExpressionError: An expression is invalid.
            ValueError: Parameters are invalid.
        """
        return Followers({name: self._follower(use, simulation) for name, use in self._uses.items()}, simulation)

    def check(self, name: str, built: Built, problem: Problem) -> Problem | None:
        """Return the problem with a metric, if there is one.

        Args:
            name: Its name.
            built: The scenario whose run the metric is to follow.
            problem: A problem located at the metric as a whole.
        """
        try:
            self._description(name, self._uses[name])
            self._follower(self._uses[name], built.simulation, built.document.specifications)
        except PluginError as error:
            return replace(
                problem, code=error.code, message=str(error), expected=error.expected, suggestion=error.suggestion
            )
        except ExpressionError as error:
            span, text = problem.span, self._uses[name]
            if span is not None and isinstance(text, str):
                shift = (problem.source_line or "").find(text)
                if shift >= 0:
                    span = replace(span, column=shift + error.start + 1, end_column=shift + max(error.end, 1) + 1)
            near = nearest(error.name, error.names) if error.name else None
            return replace(problem, message=error.problem, span=span, suggestion=near)
        except ValueError as error:
            return replace(problem, message=" ".join(str(error).split()))
        return None

    def _description(self, name: str, use: str | MetricUse) -> MetricDescription:
        if isinstance(use, str):
            return MetricDescription(name, "number", "", use)
        kind = self._catalogue.load("metric", use.use)
        return MetricDescription(name, kind.kind, kind.unit, (kind.__doc__ or use.use).partition("\n")[0], kind.version)

    def _follower(
        self, use: str | MetricUse, simulation: Simulation, specifications: Collection[str] | None = None
    ) -> Follower:
        if isinstance(use, str):
            return ReducedSeries(use, simulation, specifications)
        kind = self._catalogue.load("metric", use.use)
        metric: Metric = kind(kind.Parameters.model_validate(use.with_, strict=True))
        metric.attach(simulation.environment, simulation.groups, simulation.events)
        return metric


def typed(value: Any, kind: str) -> Any:
    """Convert the value of a metric to its type in the table.

    Raises:
        TypeError: The value is of another type.
    """
    if kind == "series" and value is not None:
        return [{"time": float(time), "value": float(number)} for time, number in value]
    found: Any = value.item() if isinstance(value, np.generic) else value
    if found is None or (isinstance(found, float) and math.isnan(found)):
        return None
    is_sound = isinstance(found, _TYPES[kind]) and (kind == "truth" or not isinstance(found, bool))
    if not is_sound:
        raise TypeError(f"it is {quoted(repr(found))}, and was declared to be of the kind {kind}")
    return float(found) if kind == "number" else found
