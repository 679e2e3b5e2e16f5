"""Manoeuvres: simple motions whose separation from others is known by simulation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.planning.optimal_control import Plan

Array = NDArray[np.float64]

#: How many speeds are tried, from the least to the greatest.
_SPEEDS = 4
#: For how many steps an aircraft turns before it flies straight on.
_TURNING = (1, 2, 3, 4, 6, 8, 11, 15, 20, 27)


def manoeuvres(bounds: tuple[Array, Array], steps: int) -> Array:
    """Return the control inputs of all manoeuvres.

    At a constant speed they fly straight on, turn as fast as allowed to one side and fly straight on, or turn back
    before they do so, which leads to a parallel course.

    Args:
        bounds: The least and the greatest speed [m/s] and turn rate [rad/s]; each of shape (2,).
        steps: The number of steps, N.

    Returns:
        Shape (K, N, 2).
    """
    (slowest, right), (fastest, left) = bounds
    turns = [np.zeros(steps)]
    for duration in (each for each in _TURNING if each <= steps):
        for rate, back in ((left, right), (right, left)):
            turning = np.zeros(steps)
            turning[:duration] = rate
            turns.append(turning.copy())
            turning[duration : 2 * duration] = back
            turns.append(turning)
    speeds = np.linspace(slowest, fastest, _SPEEDS)
    inputs = np.empty((_SPEEDS, len(turns), steps, 2))
    inputs[..., 0], inputs[..., 1] = speeds[:, None, None], np.array(turns)
    return inputs.reshape(-1, steps, 2)


def clearance(plans: ArrayLike, scenarios: Array, counting: tuple[Array, Array]) -> Array:
    """Return the least distance of plans from the scenarios that count, at the stages 1 to N [m].

    Args:
        plans: The states of K plans; shape (K, N + 1, nx).
        scenarios: Positions, NaN for missing others; shape (M, N + 1, 2).
        counting: Which scenarios count at the stages 1 to N - 1, and at N; each a mask of shape (M,).

    Returns:
        Infinity without scenarios; shape (K,).
    """
    positions = np.asarray(plans, float)[:, None, 1:, :2]
    apart = np.sqrt(np.square(positions - scenarios[None, :, 1:]).sum(axis=3))
    counts = np.repeat(counting[0][:, None], apart.shape[2], axis=1)
    counts[:, -1] = counting[1]
    least: Array = np.where(counts & ~np.isnan(apart), apart, np.inf).min(axis=(1, 2), initial=np.inf)
    return least


def safest(
    state: Array,
    inputs: Array,
    rest: Plan,
    scenarios: Array,
    counting: tuple[Array, Array],
    separation: float,
    target: Array,
) -> tuple[Plan, float]:
    """Return the motion to follow where no plan was found, and its clearance [m].

    That is the rest of the previous plan, if it keeps the separation; else the manoeuvre that keeps it and stays
    nearest to the target, in the mean of the squared distances; else the motion with the greatest clearance.

    Args:
        state: The present state; shape (3,).
        inputs: Those of the manoeuvres; shape (K, N, 2).
        rest: The rest of the previous plan.
        scenarios: See `clearance`.
        counting: See `clearance`.
        separation: The least distance to keep [m].
        target: Where to fly, x [m] and y [m] first.
    """
    dynamics = rest.dynamics
    states = np.empty((len(inputs), inputs.shape[1] + 1, len(state)))
    states[:, 0] = state
    for k in range(inputs.shape[1]):
        states[:, k + 1] = dynamics(states[:, k], inputs[:, k])
    # The rest of the plan starts where it predicted the state, which noise may have changed.
    followed = Plan(dynamics.rollout(state, rest.inputs), rest.inputs, dynamics, rest.left)
    found = clearance(np.concatenate([followed.states[None], states]), scenarios, counting)
    if found[0] >= separation:
        return followed, float(found[0])
    keeping = np.flatnonzero(found[1:] >= separation)
    if len(keeping):
        distances = np.square(states[keeping, 1:, :2] - target[:2]).sum(axis=2).mean(axis=1)
        chosen = int(keeping[distances.argmin()])
    else:
        chosen = int(found.argmax()) - 1
        if chosen < 0:
            return followed, float(found[0])
    return Plan(states[chosen], inputs[chosen], dynamics, 0), float(found[chosen + 1])
