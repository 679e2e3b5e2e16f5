"""Checks of metrics: values of the declared type, repeatability, and no effect on the run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, get_args, get_type_hints

from symaware_cli.core import Metric
from symaware_cli.language import KINDS
from symaware_cli.studies import typed
from symaware_cli.testing.conformance import DeviationList, require_kind, with_parameters
from symaware_cli.testing.side_effects import fingerprint, watched
from symaware_cli.testing.small_scenario import Changes, SmallScenario, difference, scenario, started, world_state

_KIND = next(each for each in KINDS if each.name == "metric")


def check_metric(kind: type[Metric], changes: Changes | None = None, /, **parameters: Any) -> None:
    """Check a metric of a run of three agents with eight steps.

    The value must be of the declared `kind` and finite, equal in a second run, and the run must be equal to one without
    the metric.

    Args:
        kind: The class.
        changes: Values of the scenario by their paths, such as ``{"agents.robot.components.estimate": {"use": ...}}``.
        parameters: The parameters of the metric.

    Raises:
        ConformanceError: A line for each deviation.
    """
    found = require_kind(kind, _KIND)
    kinds = get_args(get_args(get_type_hints(Metric)["kind"])[0])
    if kind.kind not in kinds:
        found.add("kind", f"is {kind.kind!r}", f"one of {', '.join(kinds)}")
    if not isinstance(kind.unit, str):
        found.add("unit", f"is {kind.unit!r}", 'a text, such as "m"; empty for none')
    if not isinstance(kind.version, int) or isinstance(kind.version, bool):
        found.add("version", f"is {kind.version!r}", "a whole number, which changes with the meaning")
    found.settle()
    small = SmallScenario(scenario(), changes, found)
    plain, _ = _follow(small, None)
    followed, value = _follow(small, with_parameters(found, parameters))
    found.settle()
    changed = difference(plain, followed)
    if changed is not None:
        found.add("look", f"changes the run: {changed}", "only read the world and the groups")
    _check_value(found, value)
    _, again = _follow(small, with_parameters(found, parameters))
    if fingerprint(value) != fingerprint(again):
        found.add("value", f"is {value!r}, and {again!r} in a second run", "depend on the run only")
    found.settle()


def _follow(small: SmallScenario, metric: Metric | None) -> tuple[list[dict[str, str]], Any]:
    """Make a run; return its trace and the value of a metric."""
    found, value, course = small.found, None, []
    built = small.build()
    simulation = built.simulation
    if metric is not None:
        with found.calling("begin"), watched(found, "begin"):
            metric.attach(simulation.environment, simulation.groups, simulation.events)

    def look() -> None:
        if metric is not None and not found:
            with found.calling("look"), watched(found, "look"):
                metric.look(simulation.clock.now)

    simulation.events.subscribe("stepping", lambda event: look())
    with started(built) as run:
        while run.status is None:
            run.advance(1)
            course.append(world_state(run))
        look()
        if run.failure is not None and metric is not None:
            found.add("subscribe", f"lets the run fail: {run.failure.problem}", "catch it in the function of the event")
        if metric is not None and not found:
            with found.calling("value"), watched(found, "value"):
                value = metric.value()
                again = metric.value()
                if fingerprint(again) != fingerprint(value):
                    found.add("value", f"returns {value!r}, and {again!r} at once afterwards", "change nothing in it")
    return course, value


def _check_value(found: DeviationList, value: Any) -> None:
    kind = found.kind.kind  # type: ignore[attr-defined]
    if kind == "series" and not isinstance(value, Sequence) and value is not None:
        found.add("value", f"returns a {type(value).__name__}", "a series is a sequence of (time [s], number)")
        return
    try:
        row = typed(value, kind)
    except (TypeError, ValueError) as error:
        found.add("value", f"does not return a {kind}: {error}", "return what `kind` declares, or None")
        return
    numbers = [each[name] for each in row for name in each] if kind == "series" and row else [row]
    if any(isinstance(each, float) and not math.isfinite(each) for each in numbers):
        found.add("value", f"is not finite: {value!r}", "return None where there is no value")
    times = [each["time"] for each in row] if kind == "series" and row else []
    if times != sorted(times):
        found.add("value", "has times that do not ascend", "sort the series by time")
