"""What agents believe of others, in columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording import wire
from symaware_cli.viewing.cast import Cast, in_space

Array = NDArray[np.float64]
Integers = NDArray[np.intp]


@dataclass(frozen=True)
class Beliefs:
    """Beliefs of the agents of one group, ordered by message and observer.

    Attributes:
        told: Time [ns] and rows of each message; None for all rows.
        message: (m,) which of these each belief comes from.
        observer: (m,) whose it is, as a row of the group.
        who: (m,) of whom, as an index in the roster.
        places: (m, 3) where that one is believed to be [m].
        covariances: (m, d, d) of the place [m^2], NaN where nothing is said; None if that is so everywhere.
        ages: (m,) how old the belief is [s].
    """

    told: Sequence[tuple[int, NDArray[np.uint32] | None]]
    message: Integers
    observer: Integers
    who: Integers
    places: Array
    covariances: Array | None
    ages: Array

    def of(self, row: int) -> tuple[NDArray[np.int64], Integers, NDArray[np.intp]]:
        """The beliefs of one agent.

        Returns:
            The times of the messages that tell of it (k,) [ns], how many beliefs each has (k,), and the indices of
            these beliefs.
        """
        telling = [number for number, (_, rows) in enumerate(self.told) if rows is None or row in rows]
        times = np.array([self.told[number][0] for number in telling], np.int64)
        mine = np.flatnonzero(self.observer == row)
        counts = np.bincount(self.message[mine], minlength=len(self.told))[telling]
        return times, counts, mine


class Reading:
    """Makes beliefs of messages."""

    def __init__(self, cast: Cast, dimension: int) -> None:
        """Look up what the states of all consist of.

        Args:
            cast: Who takes part.
            dimension: In how many dimensions the observers move.
        """
        self._dimension = dimension
        troupes = [cast.troupes[cast.place[name][0]] if name in cast.place else None for name in cast.roster]
        #: How long the state of each is, whether its position has as many dimensions, and where that stands then.
        self._width = np.array([len(troupe.state) if troupe else 0 for troupe in troupes])
        self._placed = np.array([troupe is not None and len(troupe.position) == dimension for troupe in troupes])
        self._position = np.array(
            [
                troupe.position if troupe and len(troupe.position) == dimension else tuple(range(dimension))
                for troupe in troupes
            ]
        )

    def read(self, entries: Sequence[tuple[int, wire.Awareness]], count: int, wanted: Sequence[int]) -> Beliefs:
        """Read messages of one group.

        Args:
            entries: Their times [ns] and contents. Who knows the whole world has no beliefs that differ from it.
            count: How many agents the group has.
            wanted: Whose beliefs to read, as rows of the group.
        """
        told, parts = [], []
        chosen = np.zeros(count, bool)
        chosen[list(wanted)] = True
        for number, (time, message) in enumerate(entries):
            told.append((time, message.rows))
            if message.world or not len(message.entities):
                continue
            rows = np.arange(count) if message.rows is None else message.rows.astype(np.intp)
            lengths = np.broadcast_to(message.lengths, len(rows)) if len(message.lengths) == 1 else message.lengths
            observers = np.repeat(rows, lengths)
            some = np.flatnonzero(chosen[observers])
            if len(some):
                parts.append((np.full(len(some), number), observers[some], *self._unpacked(message, some)))
        if not parts:
            none = np.empty(0, np.intp)
            return Beliefs(told, none, none, none, np.empty((0, 3)), None, np.empty(0))
        messages, observers, who, places, covariances, ages = (
            np.concatenate(column) for column in zip(*parts, strict=True)
        )
        known = None if np.isnan(covariances).all() else covariances
        return Beliefs(told, messages, observers, who, in_space(places), known, ages)

    def _unpacked(self, message: wire.Awareness, some: Integers) -> tuple[Integers, Array, Array, Array]:
        """Some of the entities of a message: who, places (m, d), covariances (m, d, d), ages (m,)."""
        who, dimension = message.entities[some].astype(np.intp), self._dimension
        if len(message.columns) == 1:
            widths = np.broadcast_to(message.columns, len(some)).astype(np.intp)
            starts = some * widths
        else:
            ends = np.cumsum(message.columns, dtype=np.intp)
            widths, starts = message.columns[some].astype(np.intp), (ends - message.columns)[some]
        columns = np.tile(np.arange(dimension), (len(some), 1))
        whole = (widths == self._width[who]) & self._placed[who]
        columns[whole] = self._position[who[whole]]
        places = message.values[starts[:, None] + columns]
        covariances = np.full((len(some), dimension, dimension), np.nan)
        if len(message.covariances) and len(message.columns) == 1:
            # A square of numbers stands behind another; in it rows behind rows.
            squares = some * widths**2
            covariances = message.covariances[
                squares[:, None, None] + columns[:, :, None] * widths[:, None, None] + columns[:, None, :]
            ]
        ages = message.ages[some] if len(message.ages) else np.zeros(len(some))
        return who, places, covariances, ages
