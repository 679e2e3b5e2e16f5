"""Sensors that detect no other agents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from symaware_cli.core import AgentGroup
from symaware_cli.engine.faults.component_fault import ComponentFault
from symaware_cli.engine.runtime.fault import FaultTargets


class Blind(ComponentFault):
    """A sensor sees no other agents."""

    @property
    def text(self) -> str:
        """Names the sensors."""
        return f"blinds {self.of}"

    def begin(self, run: FaultTargets) -> Any:
        """Remove earlier detections of the sensors, and those from now on."""
        disturbances = []
        for each in self.components:
            disturbance = partial(_blindfold, frozenset(each.rows))
            run.add_disturbance(each, disturbance)
            disturbance(each.entry.group, ())
            disturbances.append(disturbance)
        return disturbances

    def end(self, run: FaultTargets, begun: Any) -> None:
        """Let the sensors detect agents again, from their next turns on; they always measure the agent's own state."""
        for each, disturbance in zip(self.components, begun, strict=True):
            run.remove_disturbance(each, disturbance)


def _blindfold(rows: frozenset[int], group: AgentGroup, measured: Sequence[int]) -> None:
    """Remove what some agents believe about others."""
    awareness = group.awareness
    for row in sorted(rows):
        database = group.agents[row].awareness_database
        for id in list(database.others):
            del database[id]
        if database.world is not awareness.world:
            database.world = None
    if awareness.world is not None and awareness.seen is None:
        # One snapshot is shared by all agents; if it is removed for some, each of the others needs tracks.
        awareness.seen = awareness.everybody(awareness.world)
        awareness.world = None
    if awareness.seen is not None:
        awareness.seen = awareness.seen.select(~np.isin(awareness.seen.observers, sorted(rows)))
    observation = awareness.observation
    if observation is not None:
        seen = observation.tracks.select(~np.isin(observation.tracks.observers, sorted(rows)))
        awareness.observation = replace(observation, tracks=seen)
