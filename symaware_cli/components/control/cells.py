"""A controller that drives from cell to cell."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.abstraction.knowledge_model import model_named
from symaware_cli.components.control.steering import Steering, lengths
from symaware_cli.core import AgentGroup, Level
from symaware_cli.world.plugin import ParameterError
from symaware_cli.world.time import seconds

Array = NDArray[np.float64]

#: The greatest angle between the heading and the way ahead at which a vehicle drives [rad].
_ALIGNED = 1e-3
#: The distance from the middle of a side at which an agent goes on into the next cell, and that from both cells from
#: which on it has left them [m].
_AT_GATE = 1e-6


class CellSteering(Steering):
    """Drives to the cell that a strategy chose, without leaving that cell and the present one.

    An agent goes straight to the middle of the side that the two cells share, then straight to the centre of the next
    one. Cells are convex, so both ways lie within them; the speed is such that no step goes beyond the end of either. A
    vehicle with a heading first turns on the spot. This holds for single integrators and unicycles without noise that
    take a turn at each step of a kinematic world; models with noise and all others are refused. Wherever it does not
    hold, as in worlds in which forces move bodies, each turn at which an agent has left both cells is an event.
    """

    events: ClassVar = {
        "both-cells-left": "An agent is neither in its cell nor in the next; `distance` is how far outside [m].",
        "cells-entered": "An agent that had left both cells is in one of them again.",
    }

    class Parameters(Steering.Parameters):
        """Whose decisions to follow, and how fast."""

        strategy: str = Field("decide", description="The name of the component that decides.")
        model: str = Field(description="Its knowledge model, by its name under `knowledge_models`.")
        speed: float = Field(1.0, gt=0, description="Greatest speed [m/s].")

    def check(self, group: AgentGroup) -> None:
        """Check that the model can go straight, and that there is a strategy."""
        given = self.parameters
        model_named(given.model, group.knowledge_models)
        if f"{given.strategy}.plan" not in group.awareness.columns:
            said = f"there is no component `{given.strategy}` that decides where to go: {{use: knowledge.strategy}}"
            raise ParameterError(said, ("strategy",))
        names, model = [each.name for each in group.model.control_input], group.model
        if model.noise_deviation(1.0) is not None:
            raise ValueError("an agent whose model has noise does not surely keep to its cells: leave the noise out")
        if model.heading is None and all(name.startswith("velocity_") for name in names):
            return
        if model.heading is not None and names == ["speed", "turn_rate"] and model.input_bounds()[0][0] <= 0.0:
            return
        raise ValueError("only a single integrator or a unicycle that can stand surely keeps to its cells")

    def initialise_component(self, group: AgentGroup) -> None:
        """Look up the cells."""
        super().initialise_component(group)
        self._cells = model_named(self.parameters.model, group.knowledge_models)
        self._step = seconds(self.environment.time_step)
        self._is_outside = np.zeros(len(group), bool)

    uncaptured = ("_cells",)

    def _compute(self) -> tuple[Array, Array, Array]:
        model, state = self._group.model, self._group.awareness.state
        position = model.positions(state)
        plan = self._group.awareness[f"{self.parameters.strategy}.plan"]
        target = position.copy()
        outside = np.zeros(len(position))
        for row, (cell, following, _) in enumerate(plan):
            if np.isfinite(cell):
                target[row, :2] = self._target(int(cell), int(following), position[row])
                outside[row] = min(self._cells.distance(int(each), position[row]) for each in (cell, following))
        way = target - position
        distance = lengths(way)
        speed = np.minimum(self.parameters.speed, distance / self._step)
        velocity = way * (speed / np.maximum(distance, 1e-12))[:, None]
        reach = np.minimum(speed[:, None] * self._ahead, distance[:, None])
        ahead = position[:, None] + (way / np.maximum(distance, 1e-12)[:, None])[:, None] * reach[:, :, None]
        return self._followed(state, velocity, speed), ahead, outside

    def _update(self, value: tuple[Array, Array, Array]) -> None:
        control_input, ahead, outside = value
        self._steer(control_input, ahead)
        is_outside = outside > _AT_GATE
        for row in np.flatnonzero(is_outside != self._is_outside).tolist():
            if is_outside[row]:
                said = f"is {outside[row]:.2g} m outside its cell and the next one"
                self.emit_for(row, "both-cells-left", said, level=Level.WARNING, distance=float(outside[row]))
            else:
                self.emit_for(row, "cells-entered", "is in its cell or the next one again")
        self._is_outside = is_outside

    def _target(self, cell: int, following: int, position: Array) -> Array:
        """Return the point to head for; shape (2,)."""
        if cell == following or self._cells.contains(following, position):
            return self._cells.centre(following)
        gate = self._cells.gate(cell, following)
        apart = gate - position[:2]
        return self._cells.centre(following) if apart @ apart < _AT_GATE**2 else gate

    def _followed(self, state: Array, velocity: Array, speed: Array) -> Array:
        """Return control inputs: velocities, or turns on the spot until the way is straight ahead; shape (n, nu)."""
        model = self._group.model
        if model.heading is None:
            return velocity
        wanted = np.arctan2(velocity[:, 1], velocity[:, 0])
        error = np.remainder(wanted - state[:, model.heading] + np.pi, 2 * np.pi) - np.pi
        moving = speed > 1e-9
        control_input = np.empty((len(state), 2))
        control_input[:, 0] = np.where(moving & (np.abs(error) < _ALIGNED), speed, 0.0)
        # While it drives it does not turn, so that its path is straight.
        control_input[:, 1] = np.where(moving & (np.abs(error) >= _ALIGNED), error / self._step, 0.0)
        return control_input
