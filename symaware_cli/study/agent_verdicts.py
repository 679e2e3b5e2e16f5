"""What became of specifications for each agent, or pair of agents, in a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from symaware_cli.specification.outcome import VERDICTS
from symaware_cli.specification.specification_monitor import SpecificationMonitor

#: How many agents or pairs a row has at most: the worst ones.
MOST_AGENTS = 256

#: What a column is called, before the name of the specification.
PREFIX = "by_agent."


def agent_verdicts(monitors: Sequence[SpecificationMonitor], run: int = 0, runs: int = 1) -> Mapping[str, Any]:
    """Return what became of each specification that is about several agents or pairs, the worst first.

    Args:
        monitors: The monitors, with the rows of all runs that share them.
        run: Which of these runs.
        runs: How many there are.
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
                # In a batch, ids begin with the number of the run.
                "agent": " and ".join(id.rpartition(":")[2] for id in scope.agents(row)),
                "verdict": VERDICTS[verdict],
                "robustness": value if np.isfinite(value) else None,
            }
            for row, verdict, value in zip(
                rows[order].tolist(), monitor.verdicts[rows[order]].tolist(), robustness[order].tolist(), strict=True
            )
        ]
    return found
