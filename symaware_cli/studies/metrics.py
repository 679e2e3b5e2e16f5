"""The built-in metrics of a run, and the outcomes of specifications for each agent."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from symaware_cli.engine import RunSummary, Simulation
from symaware_cli.specification import REJECTED, VERDICTS, Outcome, SpecificationMonitor
from symaware_cli.studies.measurement import MOST_GOALS, RunMeasurement


@dataclass(frozen=True, slots=True)
class MetricDescription:
    """The description of a metric.

    Attributes:
        name: Its name.
        kind: The type of its values: ``number``, ``integer``, ``truth`` or ``text``; ``times``, a list of agents with
            the time [s] of an event for each; or ``series``, a list of times [s] with a value each.
        unit: The unit; empty for none.
        description: A sentence about its meaning.
        version: A number that changes when the same run gives another value.
    """

    name: str
    kind: str
    unit: str
    description: str
    version: int = 1


@dataclass(frozen=True, slots=True)
class RunFigures:
    """The sources of metrics at the end of a run.

    Attributes:
        summary: The summary of the run.
        measurement: The measurements during the run.
        simulation: The simulation of the run.
    """

    summary: RunSummary
    measurement: RunMeasurement
    simulation: Simulation


_Value = Callable[[RunFigures], Any]


def _of_offers(run: RunFigures, counts: Callable[[Outcome, bool], bool]) -> int | None:
    """Count specifications selected by outcome and by whether an agent holds them; None without offers."""
    board = next((group.offers for group in run.simulation.groups if group.offers is not None), None)
    if board is None:
        return None
    holders = board.holders
    return sum(counts(each, each.name in holders) for each in run.summary.specifications)


_BUILT_IN: tuple[tuple[MetricDescription, _Value], ...] = (
    (
        MetricDescription("time", "number", "s", "simulated time at the end of the run"),
        lambda run: run.summary.simulated_time,
    ),
    (
        MetricDescription("contacts", "integer", "", "contacts that began"),
        lambda run: run.summary.contacts,
    ),
    (
        MetricDescription("closest", "number", "m", "the least distance between the outlines of two agents"),
        lambda run: run.summary.minimum_separation and run.summary.minimum_separation.value,
    ),
    (
        MetricDescription("highest_risk", "number", "", "the greatest risk that an agent saw"),
        lambda run: run.summary.highest_risk and run.summary.highest_risk.value,
    ),
    (
        MetricDescription("goals_reached", "integer", "", "agents that reached the goal that they have at the end"),
        lambda run: len(run.summary.goals_reached),
    ),
    (
        MetricDescription("goal_time", "number", "s", "when the last goal was reached that was reached"),
        lambda run: run.measurement.goal_time,
    ),
    (
        MetricDescription("goals", "times", "s", f"who reached a goal, and when; the first {MOST_GOALS}"),
        lambda run: [each._asdict() for each in run.measurement.goals],
    ),
    (
        MetricDescription("path_length", "number", "m", "the way of all agents together"),
        lambda run: run.measurement.path_length,
    ),
    (
        MetricDescription("effort", "number", "", "the squared control inputs of all agents, integrated over time"),
        lambda run: run.measurement.effort,
    ),
    (
        MetricDescription("messages_sent", "integer", "", "messages that agents sent to one another"),
        lambda run: run.simulation.exchange.sent,
    ),
    (
        MetricDescription("messages_lost", "integer", "", "messages that did not arrive"),
        lambda run: run.simulation.exchange.dropped,
    ),
    (
        MetricDescription("failures", "integer", "", "failures of components that did not end the run"),
        lambda run: run.summary.failures,
    ),
    (
        MetricDescription("offers_accepted", "integer", "", "specifications that were offered and that an agent has"),
        lambda run: _of_offers(run, lambda outcome, is_held: is_held),
    ),
    (
        MetricDescription("offers_violated", "integer", "", "those of them that are violated"),
        lambda run: _of_offers(run, lambda outcome, is_held: is_held and outcome.verdict == "violated"),
    ),
    (
        MetricDescription("offers_rejected", "integer", "", "specifications that were offered and that nobody took"),
        lambda run: _of_offers(run, lambda outcome, is_held: outcome.verdict == REJECTED),
    ),
)

#: Names of further columns.
RESERVED = ("index", "replicate", "variant", "seed", "state", "digest", "error")

#: The metrics that every row has, and those of them that are numbers or booleans.
BUILT_IN = tuple(description for description, _ in _BUILT_IN)
NUMERIC = tuple(description for description in BUILT_IN if description.kind not in ("text", "times"))


def figures(run: RunFigures) -> dict[str, Any]:
    """Return the value of each metric by its name."""
    return {description.name: value(run) for description, value in _BUILT_IN}


#: The maximum number of agents or pairs in a row; the worst are kept.
MOST_AGENTS = 256

#: The prefixes of column names, before the name of the specification.
PREFIX = "by_agent."


def agent_verdicts(monitors: Sequence[SpecificationMonitor], run: int = 0, runs: int = 1) -> Mapping[str, Any]:
    """Return the outcome of each specification of several agents or pairs, for each of them, the worst first.

    Args:
        monitors: The monitors, with the rows of all runs of the batch.
        run: The number of the run within the batch.
        runs: The number of runs in the batch.
    """
    found: dict[str, Any] = {}
    for monitor in monitors:
        scope = monitor.specification.scope
        share = scope.rows // runs
        rows = np.arange(run * share, (run + 1) * share)
        if share == 1 and not scope.agents(0):
            continue
        rows = rows[monitor.begun[rows]]
        robustness = np.where(np.isnan(monitor.settled), monitor.upper, monitor.settled)[rows]
        order = np.lexsort((rows, robustness, monitor.verdicts[rows]))[:MOST_AGENTS]
        found[PREFIX + monitor.specification.name] = [
            {
                # In a batch, ids are prefixed with the number of the run.
                "agent": " and ".join(id.rpartition(":")[2] for id in scope.agents(row)),
                "verdict": VERDICTS[verdict],
                "robustness": value if np.isfinite(value) else None,
            }
            for row, verdict, value in zip(
                rows[order].tolist(), monitor.verdicts[rows[order]].tolist(), robustness[order].tolist(), strict=True
            )
        ]
    return found
