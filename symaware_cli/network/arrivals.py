"""The order of arrived messages: oldest first for each receiver, in as few deliveries as possible."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from symaware_cli.core import Delivery


def in_order(arrived: Sequence[Delivery]) -> Sequence[Delivery]:
    """Order deliveries so that each receiver reads its messages oldest first.

    Messages of equal times are ordered by the sender's index in the roster, then by the sender's own order. Messages of
    one delivery stay together if possible: a delivery is split only if a receiver has another message in between.

    Args:
        arrived: The deliveries, each in this order within itself.
    """
    if len(arrived) < 2:
        return arrived
    firsts, lasts = ([_key(each, place) for each in arrived] for place in (0, -1))
    order = sorted(range(len(arrived)), key=firsts.__getitem__)
    arrived = [arrived[place] for place in order]
    if all(lasts[before] <= firsts[after] for before, after in itertools.pairwise(order)):
        return arrived
    counts = [len(each) for each in arrived]
    source = np.repeat(np.arange(len(arrived)), counts)
    columns = zip(*((each.due, each.senders, each.sequences, each.receivers) for each in arrived), strict=True)
    due, senders, sequences, receivers = map(np.concatenate, columns)
    # Assign messages to rounds: each receiver goes through the sources in turn, round after round.
    by_receiver = np.lexsort((sequences, senders, due, receivers))
    sources, theirs = source[by_receiver], receivers[by_receiver]
    begins = np.concatenate([[True], theirs[1:] != theirs[:-1]])
    steps = np.concatenate([[0], np.diff(sources) % len(arrived)])
    steps[begins] = 0
    total = np.cumsum(steps)
    start = np.maximum.accumulate(np.where(begins, np.arange(len(total)), 0))
    turn = np.empty(len(total), np.int64)
    turn[by_receiver] = total - total[start] + sources[start]
    within = np.arange(len(source)) - np.repeat(np.cumsum(counts) - counts, counts)
    by_turn = np.argsort(turn, kind="stable")
    cuts = np.flatnonzero(np.diff(turn[by_turn])) + 1
    pieces = []
    for piece in np.split(by_turn, cuts):
        whole = arrived[int(source[piece[0]])]
        pieces.append(whole if len(piece) == len(whole) else whole.some(within[piece]))
    return pieces


def _key(delivery: Delivery, place: int) -> tuple[int, int, int]:
    sender = delivery.batch.senders[delivery.rows[place]]
    return int(delivery.due[place]), int(sender), int(delivery.sequences[place])
