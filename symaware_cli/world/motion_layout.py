"""Motion: position and velocity, the common layout of beliefs about other agents."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.world.arrays import real
from symaware_cli.world.quantity import Quantity

if TYPE_CHECKING:
    from symaware_cli.world.model import Model

Array = NDArray[np.float64]

_AXES = "xyz"


def motion_quantities(dimensions: int) -> tuple[Quantity, ...]:
    """Return the elements of a motion: ``x``, ``y``, ``vx``, ``vy`` in the plane, and so on."""
    axes = _AXES[:dimensions]
    return (*(Quantity(axis, "m") for axis in axes), *(Quantity(f"v{axis}", "m/s") for axis in axes))


def motions_of(model: Model, states: Array, dimensions: int) -> Array:
    """Return positions and velocities for states of a model.

    Args:
        model: The model.
        states: The states; shape (n, nx).
        dimensions: The dimensions of the world; planar agents are at height 0.

    Returns:
        Shape (n, 2 dimensions); velocities are NaN where they are no part of the state.
    """
    size = len(model.position)
    motions = np.zeros((len(states), 2 * dimensions))
    motions[:, :size] = states[:, list(model.position)]
    motions[:, dimensions : dimensions + size] = states[:, list(model.velocities)] if model.velocities else np.nan
    return motions


def motion_of(model: Model, state: ArrayLike, dimensions: int) -> Array:
    """Return position and velocity for one state of a model, shape (nx,); see `motions_of`."""
    motion: Array = motions_of(model, real(state)[None], dimensions)[0]
    return motion


def as_motion(id: str, state: ArrayLike, model: Model | None, dimensions: int, *, is_state: bool = False) -> Array:
    """Convert a belief about another agent to the common layout.

    Args:
        id: The id of the other agent.
        state: A motion, a state of its model, or a position alone.
        model: Its model; None if unknown.
        dimensions: The dimensions of the world.
        is_state: Whether to interpret numbers as a state if a motion has equally many.

    Returns:
        Position and velocity, shape (2 dimensions,); NaN where unknown.

    Raises:
        ValueError: The state is none of these.
    """
    values = real(state)
    count = -1 if values.ndim != 1 else len(values)
    fits = model is not None and count == len(model.state)
    if model is not None and fits and (is_state or count != 2 * dimensions):
        return motion_of(model, values, dimensions)
    if count == 2 * dimensions:
        return values
    if count == dimensions:
        return np.concatenate([values, np.full(dimensions, np.nan)])
    names = ", ".join(quantity.name for quantity in motion_quantities(dimensions))
    said = f"{count} numbers" if values.ndim == 1 else f"an array of shape {values.shape}"
    raise ValueError(
        f"the belief about `{id}` must be its position and velocity, {2 * dimensions} numbers ({names}), or a state "
        f"of its model, not {said}"
    )
