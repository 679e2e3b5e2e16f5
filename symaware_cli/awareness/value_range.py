"""Value ranges: which numbers may be written to a quantity, and the errors about others."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness.time_series import TimeSeries
from symaware_cli.world import MOST, is_within

Array: TypeAlias = NDArray[np.float64]


class ValueRange(NamedTuple):
    """The numbers that may be written to a column.

    Attributes:
        most: The greatest magnitude of a finite number.
        nan: Whether NaN has a meaning.
        infinity: Whether infinity has a meaning.
    """

    most: float = MOST
    nan: bool = False
    infinity: bool = False

    def includes(self, values: Array) -> bool:
        """Return whether all elements of an array may be written; usually as cheap as `is_within`."""
        return is_within(values, self.most) or bool(self._sound(values).all())

    def rows_beyond(self, values: Array) -> list[int]:
        """Return the rows of an array, shape (n, ...), with elements that may not be written."""
        rows: list[int] = np.flatnonzero(~self._sound(values).reshape(len(values), -1).all(axis=1)).tolist()
        return rows

    def _sound(self, values: Array) -> NDArray[np.bool_]:
        sound: NDArray[np.bool_] = np.abs(values) <= self.most
        if self.nan:
            sound |= np.isnan(values)
        if self.infinity:
            sound |= np.isinf(values)
        return sound


#: The bounds of numbers without a declaration.
FINITE = ValueRange()


def require_within(bounds: ValueRange, value: Array | TimeSeries, what: str) -> None:
    """Raise a `ValueError` with the name of a value if it is out of bounds.

    Args:
        bounds: The bounds.
        value: A series or a vector; a vector of NaN alone was not written yet.
        what: The name.
    """
    values = value.values if isinstance(value, TimeSeries) else value
    if not bounds.includes(values) and (isinstance(value, TimeSeries) or not np.isnan(value).all()):
        raise ValueError(f"{what} is not finite: {values.tolist()}")


class NotFiniteError(ValueError):
    """A deferred series is out of its bounds, which was found when it was computed.

    Attributes:
        path: The path of the component that wrote it.
        use: The plugin of that component.
    """

    def __init__(self, problem: str, path: str, use: str) -> None:
        super().__init__(problem)
        self.path = path
        self.use = use
