"""What agents believe of others, in columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording import wire
from symaware_cli.viewing.views import in_space

Array = NDArray[np.float64]
Integers = NDArray[np.intp]


@dataclass(frozen=True)
class Beliefs:
    """Beliefs of the agents of one group, ordered by message and observer.

    Attributes:
        times: (k,) of the messages [ns].
        told: (k, n) whose beliefs each message is about; all that an agent believes, wherever it is about that agent.
        message: (m,) which of the messages each belief comes from.
        observer: (m,) whose it is, as a row of the group.
        who: (m,) of whom, as an index in the roster.
        places: (m, 3) where that one is believed to be [m].
        covariances: (m, d, d) of the place [m^2], NaN where nothing is said; None if that is so everywhere.
        ages: (m,) how old the belief is [s].
    """

    times: NDArray[np.int64]
    told: NDArray[np.bool_]
    message: Integers
    observer: Integers
    who: Integers
    places: Array
    covariances: Array | None
    ages: Array

    def of(self, row: int) -> tuple[NDArray[np.int64], Integers, NDArray[np.intp]]:
        """The beliefs of one agent.

        Returns:
            The times of the messages that tell of it (j,) [ns], how many beliefs each has (j,), and the indices of
            these beliefs.
        """
        telling, mine = self.told[:, row], np.flatnonzero(self.observer == row)
        counts = np.bincount(self.message[mine], minlength=len(self.times))
        return self.times[telling], counts[telling], mine


@dataclass(frozen=True)
class _Flat:
    """The contents of several messages one after another: what there is of each entity in them.

    Attributes:
        message: (m,) which message it comes from.
        observer: (m,) whose belief it is.
        who: (m,) of whom.
        width: (m,) how many numbers it has.
        start: (m,) where these begin among the values.
        square: (m,) where its covariance begins among the covariances; -1 without one.
        ages: (m,) [s].
        values: All numbers.
        covariances: All covariances.
    """

    message: Integers
    observer: Integers
    who: Integers
    width: Integers
    start: Integers
    square: Integers
    ages: Array
    values: Array
    covariances: Array


class Reading:
    """Makes beliefs of messages."""

    def __init__(self, dimension: int) -> None:
        """Take note of what of a belief to read: it begins with the position.

        Args:
            dimension: In how many dimensions the observers move.
        """
        self._dimension = dimension

    def read(self, entries: Sequence[tuple[int, wire.Awareness]], count: int, wanted: Sequence[int]) -> Beliefs:
        """Read messages of one group.

        Args:
            entries: Their times [ns] and contents. Who knows the whole world has no beliefs that differ from it.
            count: How many agents the group has.
            wanted: Whose beliefs to read, as rows of the group.
        """
        told = np.zeros((len(entries), count), bool)
        for number, (_, message) in enumerate(entries):
            told[number, slice(None) if message.rows is None else message.rows] = True
        known = [(number, message) for number, (_, message) in enumerate(entries) if len(message.entities)]
        times = np.array([time for time, _ in entries], np.int64)
        if not known:
            none = np.empty(0, np.intp)
            return Beliefs(times, told, none, none, none, np.empty((0, 3)), None, np.empty(0))
        flat = _flattened(known, count)
        chosen = np.zeros(count, bool)
        chosen[list(wanted)] = True
        some = np.flatnonzero(chosen[flat.observer])
        who, width = flat.who[some], flat.width[some]
        columns = np.broadcast_to(np.arange(self._dimension), (len(some), self._dimension))
        places = in_space(flat.values[flat.start[some, None] + columns])
        covariances = None
        sure = np.flatnonzero(flat.square[some] >= 0)
        if len(sure):
            # A square of numbers stands behind another; in it rows behind rows.
            covariances = np.full((len(some), self._dimension, self._dimension), np.nan)
            rows, squares = columns[sure], flat.square[some[sure], None, None]
            places_in_it = rows[:, :, None] * width[sure, None, None] + rows[:, None]
            covariances[sure] = flat.covariances[squares + places_in_it]
        ages = flat.ages[some]
        return Beliefs(times, told, flat.message[some], flat.observer[some], who, places, covariances, ages)


def _flattened(known: Sequence[tuple[int, wire.Awareness]], count: int) -> _Flat:
    """Put messages that have entities, and their numbers, one after another."""
    numbers, rows, lengths, entities, widths, sure, ages = [], [], [], [], [], [], []
    for number, message in known:
        here = np.arange(count) if message.rows is None else message.rows
        size = len(message.entities)
        rows.append(here)
        numbers.append(np.full(len(here), number))
        lengths.append(message.lengths if len(message.lengths) == len(here) else message.lengths.repeat(len(here)))
        entities.append(message.entities)
        widths.append(message.columns if len(message.columns) == size else message.columns.repeat(size))
        sure.append(np.full(size, len(message.covariances) > 0))
        ages.append(message.ages if len(message.ages) else np.zeros(size))
    each, width = np.concatenate(lengths), np.concatenate(widths).astype(np.intp)
    known_square = np.concatenate(sure)
    areas = np.where(known_square, width**2, 0)
    return _Flat(
        message=np.repeat(np.concatenate(numbers), each),
        observer=np.repeat(np.concatenate(rows).astype(np.intp), each),
        who=np.concatenate(entities).astype(np.intp),
        width=width,
        start=np.cumsum(width) - width,
        square=np.where(known_square, np.cumsum(areas) - areas, -1),
        ages=np.concatenate(ages),
        values=np.concatenate([message.values for _, message in known]),
        covariances=np.concatenate([message.covariances for _, message in known]),
    )
