"""A velocity controller for quadrotors."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup
from symaware_cli.core.event import Level
from symaware_cli.engine.components.control.steering import Steering, scaled
from symaware_cli.geometry import Array, lengths

#: [s] The attitude loop, corrected at 20 rad/s, settles with turns of up to 0.04 s, and never with 0.05 s.
_LONGEST = 0.025


class QuadrotorVelocity(Steering):
    """Flies each quadrotor at the velocity in its knowledge ``velocity``, with its nose at a yaw angle.

    A cascade: proportional and integral action on the velocity yields an acceleration; the model converts it to thrust
    and attitude, the attitude to torques, and these to rotor speeds. The integral compensates forces that the model
    lacks, such as a downwash. It is held while the acceleration is limited.

    The knowledge is read at each turn, so another component may change the velocity. The intent is the straight path
    ahead.
    """

    knowledge: ClassVar = {"velocity": "at which velocity to fly [m/s], as [x, y, z]"}
    events: ClassVar = {
        "turns-too-rare": "Turns are more than 1/40 s apart, as `period` says [s]: it flies badly; fired once."
    }

    class Parameters(Steering.Parameters):
        """Gains, yaw and limits."""

        yaw: float | None = Field(None, description="Where the nose points [rad]; as at the start if null.")
        gain: float = Field(4.0, gt=0, description="Acceleration for each m/s that is missing [1/s].")
        integral_gain: float = Field(0.5, ge=0, description="The same for each metre that has been lost [1/s^2].")
        max_acceleration: float = Field(5.0, gt=0, description="Greatest acceleration that is asked for [m/s^2].")

    def check(self, group: AgentGroup) -> None:
        """Check that the model accepts accelerations, and that the velocity has three coordinates."""
        if not hasattr(group.model, "accelerate"):
            raise ValueError("it flies quadrotors, whose model turns an acceleration into the speeds of rotors")
        _desired_velocity(group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Store the yaw angles."""
        super().initialise_component(group)
        heading = group.model.heading
        assert heading is not None
        yaw = self.parameters.yaw
        self._yaw = group.initial_state[:, heading].copy() if yaw is None else np.full(len(group), float(yaw))
        self._integral = np.zeros((len(group), 3))
        self._before: int | None = None
        self._has_warned = False

    def _compute(self) -> tuple[Array, Array, Array]:
        model, parameters, state = self._group.model, self.parameters, self._group.awareness.state
        wanted = _desired_velocity(self._group)
        missing = wanted - model.velocity(state, self._group.control_input)
        passed = 0.0 if self._before is None else (self.now - self._before) / 1e9
        integral = self._integral + passed * missing
        asked = parameters.gain * missing + parameters.integral_gain * integral
        size = lengths(asked)
        share = np.minimum(1.0, parameters.max_acceleration / np.maximum(size, 1e-9))
        integral = np.where((share < 1.0)[:, None], self._integral, integral)
        control_input = model.accelerate(state, scaled(asked, share), self._yaw)  # type: ignore[attr-defined]
        ahead = model.positions(state)[:, None, :] + wanted[:, None, :] * self._ahead[None, :, None]
        return control_input, ahead, integral

    def _update(self, value: tuple[Array, Array, Array]) -> None:
        control_input, ahead, self._integral = value
        period = 0.0 if self._before is None else (self.computed_at - self._before) / 1e9
        if period > _LONGEST + 1e-6 and not self._has_warned:
            self._has_warned = True
            text = f"turns are {period:g} s apart, and flying well takes one every {_LONGEST:g} s"
            self.emit("turns-too-rare", text, level=Level.WARNING, period=period)
        self._before = self.computed_at
        self._steer(control_input, ahead)


def _desired_velocity(group: AgentGroup) -> Array:
    """Return the desired velocity of each agent [m/s]; shape (n, 3)."""
    velocity = group.known("velocity")
    if velocity.shape != (len(group), 3):
        raise ValueError("the knowledge `velocity` of each agent must be 3 numbers")
    return velocity
