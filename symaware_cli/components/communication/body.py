"""Fields of messages that describe the sender's body, and the covariance of its position."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator

from symaware_cli.core import Model, TimeSeries

Array = NDArray[np.float64]

#: The fields of a message that describe its sender's body and awareness; all other fields are knowledge.
BODY_FIELDS = frozenset({"position", "velocity", "state", "covariance", "awareness"})


def _check_name(name: str) -> str:
    if name in BODY_FIELDS:
        raise ValueError(f"knowledge cannot be sent as `{name}`: messages use this name for the sender's own state")
    return name


#: The name of knowledge that is sent along with the sender's state.
KnowledgeName = Annotated[str, AfterValidator(_check_name)]


def position_covariance(model: Model, uncertainty: TimeSeries) -> Array:
    """Return the covariance of the position; shape (d, d). NaN if the uncertainty is not that of the state.

    Args:
        model: The model with the state.
        uncertainty: At its first instant the covariance of the state, row by row, or something else.
    """
    size, columns = len(model.state), np.array(model.position)
    if not len(uncertainty) or uncertainty.values.shape[1] != size * size:
        return np.full((len(columns), len(columns)), np.nan)
    covariance: Array = uncertainty.values[0].reshape(size, size)[np.ix_(columns, columns)]
    return covariance
