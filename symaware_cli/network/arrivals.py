"""The order of what arrived: oldest first for each receiver, in as few pieces as that takes."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from symaware_cli.core import Delivery, Message
from symaware_cli.core.message import Indices, Times
from symaware_cli.network.traffic import chosen


class _Rows(NamedTuple):
    """What the order depends on, for each message of a delivery, or for a single one.

    Attributes:
        due: When each arrived, in nanoseconds; shape (m,).
        senders: As indices in the roster; shape (m,).
        sequences: The number of each among those of its sender; shape (m,).
        receivers: As indices in the roster; shape (m,).
    """

    due: Times
    senders: Indices
    sequences: Times
    receivers: Indices


def in_order(arrived: Sequence[Delivery | Message], rank: Mapping[str, int]) -> Sequence[Delivery | Message]:
    """Put what arrived into an order in which each receiver finds its messages oldest first.

    Of equal times the sender's place in the roster decides, then the sender's own order. Messages of one delivery stay
    together as far as this allows: they are cut apart only where a receiver has something else to read in between.

    Args:
        arrived: Single messages, and messages in columns, each in this order within itself.
        rank: The place of each id in the roster.
    """
    if len(arrived) < 2:
        return arrived
    parts = [_rows(each, rank) for each in arrived]
    firsts, lasts = ([_key(part, place) for part in parts] for place in (0, -1))
    order = sorted(range(len(parts)), key=firsts.__getitem__)
    arrived, parts = [arrived[place] for place in order], [parts[place] for place in order]
    if all(lasts[before] <= firsts[after] for before, after in itertools.pairwise(order)):
        return arrived
    counts = [len(part.due) for part in parts]
    source = np.repeat(np.arange(len(parts)), counts)
    due, senders, sequences, receivers = (np.concatenate(column) for column in zip(*parts, strict=True))
    # Each receiver goes through the sources round after round, as long as there is something to read for it.
    by_receiver = np.lexsort((sequences, senders, due, receivers))
    sources, theirs = source[by_receiver], receivers[by_receiver]
    begins = np.concatenate([[True], theirs[1:] != theirs[:-1]])
    steps = np.concatenate([[0], np.diff(sources) % len(parts)])
    steps[begins] = 0
    total = np.cumsum(steps)
    start = np.maximum.accumulate(np.where(begins, np.arange(len(total)), 0))
    turn = np.empty(len(total), np.int64)
    turn[by_receiver] = total - total[start] + sources[start]
    within = np.arange(len(source)) - np.repeat(np.cumsum(counts) - counts, counts)
    by_turn = np.argsort(turn, kind="stable")
    cuts = np.flatnonzero(np.diff(turn[by_turn])) + 1
    pieces: list[Delivery | Message] = []
    for piece in np.split(by_turn, cuts):
        whole = arrived[int(source[piece[0]])]
        if isinstance(whole, Message) or len(piece) == len(whole):
            pieces.append(whole)
        else:
            pieces.append(chosen(whole, within[piece]))
    return pieces


def _rows(each: Delivery | Message, rank: Mapping[str, int]) -> _Rows:
    if isinstance(each, Message):
        numbers = each.arrival_time, rank[each.sender], each.sequence, rank[each.receiver]
        return _Rows(*(np.array([number], np.int64) for number in numbers))
    return _Rows(each.due, each.senders, each.sequences, each.receivers)


def _key(rows: _Rows, place: int) -> tuple[int, int, int]:
    return int(rows.due[place]), int(rows.senders[place]), int(rows.sequences[place])
