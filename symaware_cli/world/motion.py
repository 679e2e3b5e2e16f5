"""Motion: position and velocity, the one layout of what is believed of another, whoever perceived it or was told."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.world.arrays import real
from symaware_cli.world.model import Model, Quantity

Array = NDArray[np.float64]

_AXES = "xyz"


def motion_quantities(dimensions: int) -> tuple[Quantity, ...]:
    """Name the elements of a motion: ``x``, ``y``, ``vx``, ``vy`` in the plane, and so on."""
    axes = _AXES[:dimensions]
    return (*(Quantity(axis, "m") for axis in axes), *(Quantity(f"v{axis}", "m/s") for axis in axes))


def motions_of(model: Model, states: Array, dimensions: int) -> Array:
    """Pick positions and velocities out of states of a model.

    Args:
        model: Whose states they are.
        states: Shape (n, nx).
        dimensions: Of the world; who moves in the plane stands at height 0.

    Returns:
        Shape (n, 2 dimensions); velocities are NaN where they are no part of the state.
    """
    size = len(model.position)
    motions = np.zeros((len(states), 2 * dimensions))
    motions[:, :size] = states[:, list(model.position)]
    motions[:, dimensions : dimensions + size] = states[:, list(model.velocities)] if model.velocities else np.nan
    return motions


def motion_of(model: Model, state: ArrayLike, dimensions: int) -> Array:
    """Pick position and velocity out of one state of a model, shape (nx,); see `motions_of`."""
    motion: Array = motions_of(model, real(state)[None], dimensions)[0]
    return motion


def as_motion(id: str, state: ArrayLike, model: Model | None, dimensions: int, *, is_state: bool = False) -> Array:
    """Bring what somebody says of another into the one layout.

    Args:
        id: Of whom.
        state: A motion, a state of its model, or a position alone.
        model: Its model; None where that is not known.
        dimensions: Of the world.
        is_state: Whether as many numbers as the state of the model has are one, even if a motion has as many.

    Returns:
        Position and velocity, shape (2 dimensions,); NaN where nothing is said.

    Raises:
        ValueError: It is none of these.
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
        f"what is believed of `{id}` must be its position and velocity, {2 * dimensions} numbers ({names}), or a state "
        f"of its model, not {said}"
    )
