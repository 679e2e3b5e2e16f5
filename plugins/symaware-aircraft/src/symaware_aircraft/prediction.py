"""Prediction of aircraft: poses from turn rates, and checks of models and poses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli import AgentGroup, AwarenessVector, Quantity

Array = NDArray[np.float64]

#: The elements of a pose.
POSE = (Quantity("x", "m"), Quantity("y", "m"), Quantity("heading", "rad"))


def rollout(pose: ArrayLike, speed: ArrayLike, turn_rates: ArrayLike, step: float) -> Array:
    """Return the poses under sequences of turn rates, by the explicit Euler method as in the case study.

    Args:
        pose: The first pose, x [m], y [m] and heading [rad]; shape (3,).
        speed: One speed [m/s], or one for each step; shape (N,).
        turn_rates: The turn rate of each step in each of M sequences [rad/s]; shape (M, N).
        step: The duration of a step [s].

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
    """Return the first pose of an agent's intent, and its speeds and turn rates in the coming steps.

    Args:
        awareness: The awareness of the agent, whose intent is a series of poses, one for each step; without an intent
            it is assumed to stay where it is.
        now: Simulated time in nanoseconds.
        count: The number of steps.
        step: The duration of a step [s].

    Returns:
        The pose, shape (3,), and the speed [m/s] and the turn rate [rad/s] in each step, each of shape (count,);
        straight on at the last speed after the end of the intent.
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
    """Check that the model of a group is controlled by speed and turn rate in the plane.

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
    """Return a pose of x [m], y [m] and heading [rad] as an array; shape (3,).

    Raises:
        ValueError: The value is no pose.
    """
    try:
        pose = np.asarray(value, float)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape != (3,):
        raise ValueError(f"{what} must be x [m], y [m] and heading [rad], not {value}")
    return pose


def check_poses(group: AgentGroup, name: str) -> None:
    """Check that a piece of knowledge is a pose.

    Raises:
        ValueError: It is not three numbers.
    """
    if group.known(name).shape[1:] != (3,):
        raise ValueError(f"`{name}` must be x [m], y [m] and heading [rad]")
