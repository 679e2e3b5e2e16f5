"""Predicting where aircraft will be: from turn rates to poses, and what an aircraft is in the first place."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli import AgentGroup, AwarenessVector, Quantity

Array = NDArray[np.float64]

#: What a pose consists of.
POSE = (Quantity("x", "m"), Quantity("y", "m"), Quantity("heading", "rad"))


def rollout(pose: ArrayLike, speed: ArrayLike, turn_rates: ArrayLike, step: float) -> Array:
    """Where sequences of turn rates lead to from a pose, by the explicit Euler method as in the case study.

    Args:
        pose: x [m], y [m] and heading [rad]; shape (3,).
        speed: One [m/s], or one for each step; shape (N,).
        turn_rates: Of each step in each of M sequences [rad/s]; shape (M, N).
        step: How long a turn rate is held [s].

    Returns:
        Poses, the given one first; shape (M, N + 1, 3).
    """
    start, rates = np.asarray(pose, float), np.asarray(turn_rates, float)
    poses = np.empty((len(rates), rates.shape[1] + 1, 3))
    poses[:, 0] = start
    poses[:, 1:, 2] = step * rates
    poses[:, :, 2] = np.cumsum(poses[:, :, 2], axis=1)
    headings = poses[:, :-1, 2]
    poses[:, 1:, 0] = step * np.asarray(speed) * np.cos(headings)
    poses[:, 1:, 1] = step * np.asarray(speed) * np.sin(headings)
    poses[:, :, :2] = np.cumsum(poses[:, :, :2], axis=1)
    return poses


def course(awareness: AwarenessVector, now: int, count: int, step: float) -> tuple[Array, Array, Array]:
    """Where somebody begins, and the speeds and turn rates that the intent amounts to over the coming steps.

    Args:
        awareness: Of somebody whose intent is a series of poses, one for each step; without one it stays where it is.
        now: Simulated time in nanoseconds.
        count: How many steps to look ahead.
        step: Of the prediction [s].

    Returns:
        The pose, shape (3,), and the speed [m/s] and the turn rate [rad/s] in each step, each of shape (count,);
        straight on at the last speed where the intent ends.
    """
    intent = awareness.intent
    poses = intent.values[intent.times >= now][: count + 1]
    if not len(poses):
        return np.append(awareness.state[:2], 0.0), np.zeros(count), np.zeros(count)
    ahead = np.diff(poses, axis=0)
    speeds, turn_rates = np.zeros(count), np.zeros(count)
    if len(ahead):
        speeds[: len(ahead)] = np.hypot(ahead[:, 0], ahead[:, 1]) / step
        speeds[len(ahead) :] = speeds[len(ahead) - 1]
        turn_rates[: len(ahead)] = ahead[:, 2] / step
    return poses[0], speeds, turn_rates


def check_aircraft(group: AgentGroup) -> None:
    """Make sure that a group flies in the plane by speed and turn rate.

    Raises:
        ValueError: It has another model.
    """
    model = group.model
    state, control_input = ([quantity.name for quantity in each] for each in (model.state, model.control_input))
    if state != ["x", "y", "heading"] or control_input != ["speed", "turn_rate"]:
        raise ValueError(
            "the model must have the state x, y, heading and the control input speed, turn_rate, as dubins-aircraft "
            f"and unicycle have; this one has {', '.join(state)} and {', '.join(control_input)}"
        )


def as_pose(value: Any, what: str) -> Array:
    """What should be x [m], y [m] and heading [rad], as an array; shape (3,).

    Raises:
        ValueError: It is something else.
    """
    try:
        pose = np.asarray(value, float)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape != (3,):
        raise ValueError(f"{what} must be x [m], y [m] and heading [rad], not {value}")
    return pose


def check_poses(group: AgentGroup, name: str) -> None:
    """Make sure that a piece of knowledge is a pose.

    Raises:
        ValueError: It is not three numbers.
    """
    if group.known(name).shape[1:] != (3,):
        raise ValueError(f"`{name}` must be x [m], y [m] and heading [rad]")
