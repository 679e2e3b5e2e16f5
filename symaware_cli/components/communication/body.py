"""What agents tell of their bodies, by which others know where they are."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator

from symaware_cli.core import Model, TimeSeries

Array = NDArray[np.float64]

#: Names under which a message tells of its sender's body and awareness, and so nothing that the sender knows.
OF_THE_BODY = frozenset({"position", "velocity", "state", "covariance", "awareness"})


def _told_along(name: str) -> str:
    if name in OF_THE_BODY:
        raise ValueError(f"knowledge cannot be told along as `{name}`, which is what the sender tells of itself")
    return name


#: The name of knowledge that is told along with what the sender tells of itself.
ToldAlong = Annotated[str, AfterValidator(_told_along)]


def position_covariance(model: Model, uncertainty: TimeSeries) -> Array:
    """The covariance of the position, where an uncertainty is that of the state; shape (d, d), else NaN.

    Args:
        model: Whose state it is.
        uncertainty: At its first instant the covariance of the state, row by row, if it is one at all.
    """
    size, places = len(model.state), np.array(model.position)
    if not len(uncertainty) or uncertainty.values.shape[1] != size * size:
        return np.full((len(places), len(places)), np.nan)
    covariance: Array = uncertainty.values[0].reshape(size, size)[np.ix_(places, places)]
    return covariance
