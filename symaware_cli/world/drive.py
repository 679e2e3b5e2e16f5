"""Drives: how the body of an agent follows the velocities of its model."""

from __future__ import annotations

from symaware_cli.world.records import record


@record
class Drive:
    """How exactly the body of an agent follows the velocity of its model, as long as nothing touches it.

    In each physics step the velocity changes by at most `acceleration` times the duration of the step, straight towards
    that of the model, and its turn rate likewise. If neither is limited, the body has both at once.

    Attributes:
        step: The duration of a physics step [s].
        lag: How much later than the velocity the pose follows [s]: 0, or a physics step in worlds that move bodies
            before they change their velocities.
        acceleration: The greatest acceleration [m/s^2]; infinite for no limit.
        turn_acceleration: The greatest angular acceleration [rad/s^2]; infinite for no limit.
        turn_rate: The greatest turn rate that the world integrates as it is [rad/s].
        collides: Whether other bodies divert it.
    """

    step: float
    lag: float = 0.0
    acceleration: float = float("inf")
    turn_acceleration: float = float("inf")
    turn_rate: float = float("inf")
    collides: bool = False
