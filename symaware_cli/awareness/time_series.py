"""Time series: the form of every intent, uncertainty and risk."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.world import SECOND, nanoseconds, real, seconds

_NO_TIMES: NDArray[np.int64] = np.empty(0, np.int64)
_NO_VALUES: NDArray[np.float64] = np.empty((0, 0))
_NO_TIMES.flags.writeable = False
_NO_VALUES.flags.writeable = False


class TimeSeries:
    """Vectors at instants of simulated time; immutable, so that it can be shared without a copy.

    As a mapping it maps seconds to vectors: ``TimeSeries({0.0: [1, 2], 0.5: [1, 3]})[0.5]``. For whole arrays use
    `sampled`, `times` and `values`.

    Attributes:
        times: The instants, ascending, in nanoseconds; shape (h,).
        values: One vector for each instant; shape (h, k).
    """

    __slots__ = ("times", "values")

    times: NDArray[np.int64]
    values: NDArray[np.float64]

    def __init__(self, samples: Mapping[float, ArrayLike] | None = None) -> None:
        if not samples:
            self.times, self.values = _NO_TIMES, _NO_VALUES
            return
        vectors = {nanoseconds(time): np.atleast_1d(real(value)) for time, value in samples.items()}
        if len(vectors) < len(samples):
            raise ValueError("the times of a series must ascend; two are the same to the nanosecond")
        if len({vector.shape for vector in vectors.values()}) > 1:
            raise ValueError("every value of a series must be a vector of the same length")
        times = sorted(vectors)
        self._freeze(np.array(times, np.int64), np.array([vectors[time] for time in times], float))

    @classmethod
    def sampled(cls, times: ArrayLike, values: ArrayLike) -> TimeSeries:
        """Create a series from arrays, which are copied.

        Args:
            times: Ascending instants in nanoseconds; shape (h,).
            values: A scalar (h,) or a vector (h, k) for each instant.

        Raises:
            TypeError: The values are not real numbers.
            ValueError: The shapes do not agree or the times do not ascend.
        """
        instants = np.array(times, np.int64, ndmin=1)
        vectors = np.array(real(values))
        if vectors.ndim < 2:
            vectors = vectors.reshape(-1, 1)
        if instants.ndim != 1 or vectors.ndim != 2 or len(instants) != len(vectors):
            raise ValueError(f"times of shape {instants.shape} do not fit values of shape {vectors.shape}")
        if len(instants) > 1 and not (np.diff(instants) > 0).all():
            raise ValueError("the times of a series must ascend")
        series = cls.__new__(cls)
        series._freeze(instants, vectors)
        return series

    def _freeze(self, times: NDArray[np.int64], values: NDArray[np.float64]) -> None:
        if values.ndim != 2:
            raise ValueError("every value of a series must be a vector of the same length")
        times.flags.writeable = False
        values.flags.writeable = False
        self.times, self.values = times, values

    def __getitem__(self, time: float) -> NDArray[np.float64]:
        """The vector at an instant, in seconds."""
        wanted = nanoseconds(time)
        index = int(np.searchsorted(self.times, wanted))
        if index == len(self.times) or self.times[index] != wanted:
            raise KeyError(time)
        found: NDArray[np.float64] = self.values[index]
        return found

    def get(self, time: float, default: Any = None) -> Any:
        """The vector at an instant in seconds, or the default where there is none."""
        try:
            return self[time]
        except KeyError:
            return default

    def items(self) -> Iterator[tuple[float, NDArray[np.float64]]]:
        """Pairs of an instant in seconds and its vector, in order of time."""
        return zip(self, self.values, strict=True)

    def __contains__(self, time: float) -> bool:
        return self.get(time) is not None

    def __iter__(self) -> Iterator[float]:
        return (seconds(int(time)) for time in self.times)

    def __len__(self) -> int:
        return len(self.times)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, TimeSeries):
            return NotImplemented
        return np.array_equal(self.times, other.times) and np.array_equal(self.values, other.values)

    __hash__ = None  # type: ignore[assignment]

    def __or__(self, other: Any) -> TimeSeries:
        """Merge two series; at instants of both, the values of the right one are used."""
        if not isinstance(other, TimeSeries):
            return NotImplemented
        merged = dict(zip(self.times.tolist(), self.values, strict=True))
        merged.update(zip(other.times.tolist(), other.values, strict=True))
        times = sorted(merged)
        return TimeSeries.sampled(times, [merged[time] for time in times]) if times else TimeSeries()

    def __repr__(self) -> str:
        if not len(self):
            return "TimeSeries()"
        first, last = self.times[0] / SECOND, self.times[-1] / SECOND
        return f"TimeSeries({len(self)} vectors of {self.values.shape[1]}, {first:g} s to {last:g} s)"
