"""Beliefs of one agent about another over time, assembled from the awareness messages of a log."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording import wire
from symaware_cli.recording.series import Prediction, Series, row_position
from symaware_cli.world.motion import motion_quantities

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedBeliefs(Series):
    """The beliefs of an agent about another over simulated time, (k, columns); NaN while it knew nothing of it.

    Attributes:
        covariances: (k, columns, columns) of the values; NaN where unknown.
        ages: (k,) time since the other was last perceived, s; NaN while it knew nothing of it.
        series: Beliefs about each time series of the other, such as ``intent``, at each instant of recording.
    """

    covariances: Array
    ages: Array
    series: Mapping[str, Sequence[Prediction]]


class _Belief(NamedTuple):
    """The belief at one instant."""

    values: Array
    covariance: Array | None
    age: float


_UNKNOWN = _Belief(np.empty(0), None, np.nan)


def beliefs(
    entries: Iterable[tuple[int, wire.Awareness]],
    row: int,
    count: int,
    other: int,
    truth: Callable[[int], Array],
) -> LoggedBeliefs:
    """Assemble the beliefs of one row about one other agent.

    Args:
        entries: Time in ns and message, in order.
        row: The row of the agent that believes.
        count: Number of rows of the group.
        other: Roster index of the agent that the beliefs are about.
        truth: Returns the true position and velocity of the other at an instant in ns, (columns,), for agents that know
            the whole world.

    Raises:
        ValueError: A message is inconsistent.
    """
    known: dict[int, _Belief] = {}
    series: dict[str, list[Prediction]] = {}
    for time, message in entries:
        for told in message.series:
            place = row_position(row, told.rows)
            if place is not None:
                found = [(times, values) for whose, who, times, values in told if (whose, who) == (place, other)]
                times, values = found[-1] if found else (np.empty(0, np.int64), np.empty((0, 0)))
                before = series.setdefault(told.part, [])
                if found or (before and len(before[-1].times)):
                    before.append(Prediction(time, times.copy(), values.copy()))
        if not message.has_states:
            continue
        if message.world:
            known[time] = _Belief(truth(time), None, 0.0)
            continue
        place = row_position(row, message.rows)
        if place is not None:
            known[time] = _belief(message, place, count if message.rows is None else len(message.rows), other)
    columns = max((len(belief.values) for belief in known.values()), default=0)
    values = np.full((len(known), columns), np.nan)
    covariances = np.full((len(known), columns, columns), np.nan)
    for number, belief in enumerate(known.values()):
        size = len(belief.values)
        values[number, :size] = belief.values
        if belief.covariance is not None:
            covariances[number, :size, :size] = belief.covariance
    names, units = zip(*motion_quantities(columns // 2), strict=True) if columns in (4, 6) else ((), ())
    ages = np.array([belief.age for belief in known.values()], float)
    return LoggedBeliefs(
        np.array(list(known), np.int64), values, names, units, covariances=covariances, ages=ages, series=series
    )


def _belief(message: wire.Awareness, place: int, count: int, other: int) -> _Belief:
    """Return the belief about one other agent in a message, given the position of the row in the message."""
    lengths = message.lengths.astype(np.int64)
    if len(lengths) == 1:
        lengths = np.repeat(lengths, count)
    start = int(lengths[:place].sum())
    found = np.flatnonzero(message.entities[start : start + int(lengths[place : place + 1].sum())] == other)
    if not len(found):
        return _UNKNOWN
    index = start + int(found[-1])
    sizes = np.broadcast_to(message.columns.astype(np.int64), message.entities.shape)
    size, first, square = int(sizes[index]), int(sizes[:index].sum()), int((sizes[:index] ** 2).sum())
    values = message.values[first : first + size]
    if len(values) != size:
        raise ValueError(f"{len(values)} numbers where {size} were announced")
    covariance = None
    if len(message.covariances):
        covariance = message.covariances[square : square + size * size].reshape(size, size)
        # All zeros mean that the covariance is unknown, if the message has covariances of others.
        covariance = covariance if covariance.any() else None
    return _Belief(values, covariance, float(message.ages[index]) if len(message.ages) else 0.0)
