"""The velocity controller of quadrotors."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.components.control.steering import Steering, lengths, scaled
from symaware_cli.core import AgentGroup
from symaware_cli.core.event import Level

Array = NDArray[np.float64]

#: [s] The attitude of a quadrotor, corrected at 20 rad/s, settles with turns of up to 0.04 s, and never with 0.05 s.
_LONGEST = 0.025


class QuadrotorVelocity(Steering):
    """Flies each quadrotor at the velocity that it knows as ``velocity``, with its nose to a yaw.

    A cascade: proportional and integral action on the velocity says an acceleration; the model turns that into thrust
    and attitude, the attitude into torques, and these into the speeds of its rotors. The integral takes up what the
    model does not know, such as a downwash. It stands still while the acceleration is cut off.

    What an agent knows is read at each turn, so another component may change where it flies. The intent is the straight
    way ahead.
    """

    knowledge: ClassVar = {"velocity": "at which velocity to fly [m/s], as [x, y, z]"}
    events: ClassVar = {
        "turns-too-rare": "Turns are more than 1/40 s apart, as `period` says [s]: it flies badly; fired once."
    }

    class Parameters(Steering.Parameters):
        """How to reach the velocity."""

        yaw: float | None = Field(None, description="Where the nose points [rad]; as at the start if null.")
        gain: float = Field(4.0, gt=0, description="Acceleration for each m/s that is missing [1/s].")
        integral_gain: float = Field(0.5, ge=0, description="The same for each metre that has been lost [1/s^2].")
        max_acceleration: float = Field(5.0, gt=0, description="Greatest acceleration that is asked for [m/s^2].")

    def check(self, group: AgentGroup) -> None:
        """The model is told accelerations, and the velocity has three coordinates."""
        if not hasattr(group.model, "accelerate"):
            raise ValueError("it flies quadrotors, whose model turns an acceleration into the speeds of rotors")
        _wanted(group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Take note of where noses point."""
        super().initialise_component(group)
        heading = group.model.heading
        assert heading is not None
        yaw = self.parameters.yaw
        self._yaw = group.initial_state[:, heading].copy() if yaw is None else np.full(len(group), float(yaw))
        self._lost = np.zeros((len(group), 3))
        self._before: int | None = None
        self._told = False

    def _compute(self) -> tuple[Array, Array, Array]:
        model, parameters, state = self._group.model, self.parameters, self._group.awareness.state
        wanted = _wanted(self._group)
        missing = wanted - model.velocity(state, self._group.control_input)
        passed = 0.0 if self._before is None else (self.now - self._before) / 1e9
        lost = self._lost + passed * missing
        asked = parameters.gain * missing + parameters.integral_gain * lost
        size = lengths(asked)
        share = np.minimum(1.0, parameters.max_acceleration / np.maximum(size, 1e-9))
        lost = np.where((share < 1.0)[:, None], self._lost, lost)
        control_input = model.accelerate(state, scaled(asked, share), self._yaw)  # type: ignore[attr-defined]
        ahead = model.positions(state)[:, None, :] + wanted[:, None, :] * self._ahead[None, :, None]
        return control_input, ahead, lost

    def _update(self, value: tuple[Array, Array, Array]) -> None:
        control_input, ahead, self._lost = value
        period = 0.0 if self._before is None else (self.computed_at - self._before) / 1e9
        if period > _LONGEST + 1e-6 and not self._told:
            self._told = True
            text = f"turns are {period:g} s apart, and flying well takes one every {_LONGEST:g} s"
            self.emit("turns-too-rare", text, level=Level.WARNING, period=period)
        self._before = self.computed_at
        self._steer(control_input, ahead)


def _wanted(group: AgentGroup) -> Array:
    """The velocity that each agent is to fly at; shape (n, 3) [m/s]."""
    velocity = group.known("velocity")
    if velocity.shape != (len(group), 3):
        raise ValueError("the knowledge `velocity` of each agent must be 3 numbers")
    return velocity
