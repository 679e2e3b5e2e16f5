"""Sensors that measure the agent's own state with an error: an offset, or noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli import core
from symaware_cli.core import AgentGroup
from symaware_cli.core.identifiers import ComponentPattern
from symaware_cli.engine.faults.component_fault import ComponentFault
from symaware_cli.engine.runtime.fault import FaultContext, FaultTargets
from symaware_cli.engine.runtime.simulation import ComponentEntry
from symaware_cli.engine.runtime.turn import Turns
from symaware_cli.geometry import LARGEST, Number
from symaware_cli.world import GroupChance, agent_numbers

Array = NDArray[np.float64]


class MeasurementFault(ComponentFault):
    """Sensors measure the agent's own state with an error: a bias, or noise drawn at each turn, or both.

    Attributes:
        bias: The offset; shape (nx,).
        deviation: The standard deviations of the noise; shape (nx,).
    """

    bias: Array
    deviation: Array

    def begin(self, run: FaultTargets) -> Any:
        """Add the error to all measurements from now on."""
        disturbances = []
        for each in self.components:
            noise = _Noise(self.deviation.copy(), each.entry, run.seed, self.name)
            # The state of a run must not refer to the scenario's arrays: restoring it could change them.
            disturbance = partial(_mismeasure, self.bias.copy(), tuple(each.rows), noise)
            run.add_disturbance(each, disturbance)
            disturbances.append(disturbance)
        return disturbances

    def end(self, run: FaultTargets, begun: Any) -> None:
        """Stop adding the error."""
        for each, disturbance in zip(self.components, begun, strict=True):
            run.remove_disturbance(each, disturbance)

    def _vector(self, context: FaultContext, key: str) -> Array:
        """The numbers of a parameter, one for each element of the state."""
        groups = [each.entry.group for each in self.components]
        return context.vector(getattr(self.parameters, key), groups, key)


class Bias(MeasurementFault):
    """A sensor that measures the agent's own state with an offset."""

    class Parameters(core.Parameters):
        """A sensor that measures the agent's own state with an offset."""

        of: ComponentPattern
        state: list[Number] = Field(
            min_length=1, description="Offset of the measured state, in the model's order and units."
        )

    @property
    def text(self) -> str:
        """Names the sensors."""
        return f"{self.of} measures with an offset"

    def resolve(self, context: FaultContext) -> None:
        """Find the sensors."""
        super().resolve(context)
        self.bias = self._vector(context, "state")
        self.deviation = 0.0 * self.bias


class Noise(MeasurementFault):
    """A sensor that measures the agent's own state with noise."""

    class Parameters(core.Parameters):
        """A sensor that measures the agent's own state with noise."""

        of: ComponentPattern
        deviation: list[Annotated[float, Field(ge=0, le=LARGEST)]] = Field(
            min_length=1,
            description="Standard deviations of the noise of the measured state, in the model's order and units.",
        )

    @property
    def text(self) -> str:
        """Names the sensors."""
        return f"{self.of} measures with noise"

    def resolve(self, context: FaultContext) -> None:
        """Find the sensors."""
        super().resolve(context)
        self.deviation = self._vector(context, "deviation")
        self.bias = 0.0 * self.deviation


class _Noise:
    """The measurement noise of one fault in one component; draws are keyed by both, the agent and the turn."""

    def __init__(self, deviation: Array, entry: ComponentEntry, seed: int, fault: str) -> None:
        self._deviation = deviation
        self._seed = seed
        self._purpose = f"component {entry.name} fault {fault}"
        self._numbers = agent_numbers(entry.group.ids)
        self._turns = Turns()

    def reseed(self, seed: int) -> None:
        """Draw from another seed from now on."""
        self._seed = seed

    def draw(self, rows: Sequence[int], now: int) -> Array:
        """Draw the noise of some agents for the turn that ends now [ns]; shape (k, nx)."""
        noise = np.zeros((len(rows), len(self._deviation)))
        if not self._deviation.any():
            return noise
        turns = [self._turns.begin(row, now) for row in rows]
        for turn in set(turns):
            some = [place for place, each in enumerate(turns) if each == turn]
            numbers = self._numbers[[rows[place] for place in some]]
            chance = GroupChance(self._seed, self._purpose, numbers).at(turn)
            noise[some] = self._deviation * chance.standard_normal(len(self._deviation))
        return noise


def _mismeasure(bias: Array, rows: Sequence[int], noise: _Noise, group: AgentGroup, measured: Sequence[int]) -> None:
    """Add errors to the measurements of some agents in a turn."""
    awareness, errors = group.awareness, np.zeros_like(group.awareness.state)
    struck = sorted(set(rows).intersection(measured))
    errors[struck] = bias + noise.draw(struck, group.surroundings.clock.now)
    if not errors.any():
        return
    awareness.state = awareness.state + errors
    observation = awareness.observation
    if observation is not None and observation.state is not None:
        awareness.observation = replace(observation, state=observation.state + errors)
