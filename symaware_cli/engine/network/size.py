"""The size of messages in bytes, for channels with limited bandwidth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AwarenessVector, MessageBatch, TimeSeries

#: The overhead of every message: sender, receiver, kind, number and time [bytes].
HEADER = 32


def message_sizes(batch: MessageBatch) -> NDArray[np.int64]:
    """Return the size of the message in each row of a batch, in bytes; shape (s,).

    It is 8 for each number, 1 for each ASCII letter, and the header. Names in the payload are not counted: sender and
    receiver of a kind of message know its fields.
    """
    count = len(batch.senders)
    sizes = np.full(count, HEADER, np.int64)
    for values in batch.columns.values():
        sizes += _sizes(values.tolist()) if values.dtype == object else values.nbytes // max(count, 1)
    return sizes


def _sizes(values: Sequence[Any]) -> list[int]:
    """Return the sizes of values, computing that of an object that is in several rows once."""
    keys = list(map(id, values))
    known = {key: _size(value) for key, value in dict(zip(keys, values, strict=True)).items()}
    return list(map(known.__getitem__, keys))


def _size(value: Any) -> int:
    if value is None:
        return 0
    if isinstance(value, str):
        return len(value.encode())
    if isinstance(value, bytes):
        return len(value)
    if isinstance(value, bool):
        return 1
    if isinstance(value, np.ndarray):
        return value.nbytes
    if isinstance(value, TimeSeries):
        return value.times.nbytes + value.values.nbytes
    if isinstance(value, AwarenessVector):
        return len(value.id.encode()) + sum(_size(said) for _, said in value.items())
    if isinstance(value, Mapping):
        return sum(_size(key) + _size(each) for key, each in value.items())
    if isinstance(value, Iterable):
        return sum(_size(each) for each in value)
    return 8
