"""Elasticity as MuJoCo understands it: a spring with a damper for as long as bodies overlap."""

from __future__ import annotations

from functools import cache

#: How far the phase of the spring turns in a physics step [rad]: the smaller, the softer contacts are, and the more
#: exact their elasticity.
PHASE = 0.25

#: The part of the motion at a contact that the constraint determines; the rest is left to forces.
IMPEDANCE = 0.99


def solref(elasticity: float, step: float) -> tuple[float, float]:
    """Return MuJoCo's reference of a contact as negative stiffness [1/s^2] and damping [1/s].

    Args:
        elasticity: The part of the speed that is left after a collision, from 0 to 1.
        step: The physics step [s].
    """
    frequency = PHASE / step
    return -frequency * frequency, -2.0 * damping_ratio(elasticity) * frequency


@cache
def damping_ratio(elasticity: float) -> float:
    """Return the damping ratio with which bodies keep a part of their speed, found by bisection.

    At 2, a step takes all of the speed.
    """
    low, high = 0.0, 2.0
    if elasticity >= 1.0:
        return low
    for _ in range(50):
        ratio = 0.5 * (low + high)
        low, high = (ratio, high) if rebound(ratio) > elasticity else (low, ratio)
    return high


def rebound(ratio: float) -> float:
    """Return the part of the speed that a contact leaves, as the engine's steps make it.

    The mean over where within a step it begins. The engine changes velocities by the constraint, which only pushes, and
    moves bodies by the velocities after that (semi-implicit Euler).
    """
    phases, total = 8, 0.0
    for number in range(phases):
        # In units of a step: the distance from contact, and the velocity in these per step.
        distance, velocity = -(number + 0.5) / phases, -1.0
        while distance < 0.0 or velocity < 0.0:
            push = -PHASE * PHASE * distance - 2.0 * ratio * PHASE * velocity if distance < 0.0 else 0.0
            # The constraint is solved for the velocity after the step.
            velocity += IMPEDANCE * max(push, 0.0)
            distance += velocity
            if distance < 0.0 and 0.0 <= velocity < 1e-6:
                break
        total += max(velocity, 0.0)
    return total / phases
