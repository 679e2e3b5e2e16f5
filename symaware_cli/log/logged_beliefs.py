"""Beliefs of one agent about another over time, assembled from the awareness messages of a log."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import others_message
from symaware_cli.log.series import Prediction, Series, row_position
from symaware_cli.world import motion_quantities, record

Array = NDArray[np.float64]


@record
class LoggedBeliefs(Series):
    """The beliefs of an agent about another over simulated time, (k, columns); NaN while it knew nothing of it.

    Attributes:
        covariances: (k, columns, columns) of the values; NaN where unknown.
        ages: (k,) time since the other was last perceived, s; NaN while it knew nothing of it.
        series: Beliefs about each time series of the other, such as ``intent``, at each instant of recording.
    """

    _: KW_ONLY
    covariances: Array
    ages: Array
    series: Mapping[str, Sequence[Prediction]]


def beliefs(
    entries: Iterable[tuple[int, others_message.Awareness]],
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
    # At each instant the values, the covariance and the age.
    known: dict[int, tuple[Array, Array | None, float]] = {}
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
            known[time] = truth(time), None, 0.0
            continue
        others = message.others(count, wanted=[row])
        if row in others.present:
            known[time] = np.empty(0), None, np.nan
            for index in np.flatnonzero(others.entities == other)[-1:].tolist():
                size, spread = int(others.sizes[index]), others.covariances
                covariance = None if spread is None else spread[index, :size, :size]
                known[time] = others.values[index, :size], covariance, float(others.ages[index])
    columns = max((len(values) for values, _, _ in known.values()), default=0)
    table = np.full((len(known), columns), np.nan)
    covariances = np.full((len(known), columns, columns), np.nan)
    for number, (values, covariance, _) in enumerate(known.values()):
        size = len(values)
        table[number, :size] = values
        if covariance is not None:
            covariances[number, :size, :size] = covariance
    names, units = zip(*motion_quantities(columns // 2), strict=True) if columns in (4, 6) else ((), ())
    ages = np.array([age for _, _, age in known.values()], float)
    return LoggedBeliefs(
        np.array(list(known), np.int64), table, names, units, covariances=covariances, ages=ages, series=series
    )
