"""Consistency checks of log messages: against themselves, and against the agents and groups of the log.

They run once, where messages are decoded, so that later code can rely on valid indices and on counts that do not make
it allocate more memory than the message justifies.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import others_message, png, wire
from symaware_cli.log.index import ChannelInfo
from symaware_cli.log.json_text import read_json

_MOST_ROWS = 1 << 20
"""Maximum number of rows where the size of the group is unknown."""

_SPARE = 1 << 20
"""Maximum number of missing numbers in a message that is expanded to a matrix."""


def require_consistent(message: Any, channel: ChannelInfo) -> None:
    """Check a message.

    Args:
        message: The decoded message.
        channel: Its channel.

    Raises:
        ValueError: It contradicts itself, or refers to agents or entities that the log does not have.
    """
    check = _CHECKS.get(channel.schema.removeprefix("symaware.v1."))
    if check is not None:
        check(message, channel)


def _rows(message: wire.Rows, channel: ChannelInfo) -> None:
    _require_width(message.values, channel)
    _require_rows(message.rows, len(message.values), channel)


def _series(message: wire.SeriesRows, channel: ChannelInfo) -> None:
    lengths, points = message.lengths.astype(np.int64), len(message.values)
    if len(lengths) == 1:
        each = int(lengths[0])
        count = len(message.rows) if message.rows is not None else points // each if each else 0
        # For a single row, shared and separate times are the same.
        if len(message.times) != each or each * count != points:
            raise ValueError(f"{points} points and {len(message.times)} times, where {each} were announced for each")
    else:
        count = len(lengths)
        if not lengths.sum() == points == len(message.times):
            raise ValueError(f"{points} points and {len(message.times)} times, where {lengths.sum()} were announced")
    _require_rows(message.rows, count, channel)


def _tables(message: wire.TableRows, channel: ChannelInfo) -> None:
    _require_width(message.values, channel)
    lengths = message.lengths.astype(np.int64)
    if lengths.sum() != len(message.values):
        raise ValueError(f"{len(message.values)} entries, where {lengths.sum()} were announced")
    if message.rows is None and channel.rows is not None and len(lengths) != channel.rows:
        raise ValueError(f"tables of {len(lengths)} of {channel.rows} agents")
    _require_rows(message.rows, len(lengths), channel)


def _others_series(message: others_message.OthersSeries, channel: ChannelInfo) -> None:
    known, points, columns = (each.astype(np.int64) for each in (message.lengths, message.points, message.columns))
    if not known.sum() == len(message.entities) == len(points) == len(columns):
        raise ValueError(
            f"{len(message.entities)} others, where {known.sum()} were announced, with {len(points)} series"
        )
    # As Python integers, which do not overflow.
    numbers = sum(count * width for count, width in zip(points.tolist(), columns.tolist(), strict=True))
    if len(message.times) != points.sum() or len(message.values) != numbers:
        raise ValueError(f"{len(message.values)} numbers at {len(message.times)} times, where {numbers} were announced")
    _require_rows(message.rows, len(known), channel)
    _require_roster(message.entities, channel)


def _awareness(message: others_message.Awareness, channel: ChannelInfo) -> None:
    for part in message.series:
        _others_series(part, channel)
    if message.world or (message.series and not message.has_states):
        return
    lengths, sizes, known = message.lengths.astype(np.int64), message.columns.astype(np.int64), len(message.entities)
    if len(lengths) == 1:
        each = int(lengths[0])
        all_rows = channel.rows if channel.rows is not None else known // each if each else 0
        count = all_rows if message.rows is None else len(message.rows)
        fits = each * count == known
    else:
        count, fits = len(lengths), int(lengths.sum()) == known
    if not fits or len(sizes) not in ((1, known) if known else (0, 1)):
        raise ValueError(f"{known} others, where {lengths.sum()} were announced, with {len(sizes)} sizes")
    _require_rows(message.rows, count, channel)
    sizes = np.broadcast_to(sizes, known) if known else sizes[:0]
    width = int(sizes.max(initial=0))
    if width >= 1 << 16:
        raise ValueError(f"{width} numbers of one entity")
    numbers, squares = int(sizes.sum()), int((sizes**2).sum())
    if len(message.values) != numbers or len(message.covariances) not in (0, squares):
        raise ValueError(
            f"{len(message.values)} numbers where {numbers} were announced, with {len(message.covariances)} covariances"
        )
    if len(message.ages) not in (0, known):
        raise ValueError(f"{len(message.ages)} ages of {known} others")
    cells = known * (width * width if len(message.covariances) else width)
    if cells > 16 * (len(message.covariances) or numbers) + _SPARE:
        raise ValueError(f"one entity with {width} numbers among {known} that have far fewer")
    _require_roster(message.entities, channel)


def _knowledge(message: Any, channel: ChannelInfo) -> None:
    _require_rows(_array(message.rows), len(message.values), channel)
    for value in message.values:
        if not isinstance(read_json(value), dict):
            raise ValueError("knowledge that is not a mapping")


def _event(message: Any, channel: ChannelInfo) -> None:
    if message.data and not isinstance(read_json(message.data), dict):
        raise ValueError("event data that are not a mapping")


def _recurring(message: Any, channel: ChannelInfo) -> None:
    if len(message.name) != len(message.source):
        raise ValueError(f"{len(message.name)} event names and {len(message.source)} sources")
    _require_below(message.name, len(message.names), "a name")
    _require_below(message.source, len(message.sources), "a source")


def _message(message: Any, channel: ChannelInfo) -> None:
    if message.payload:
        read_json(message.payload)


def _message_columns(message: Any, channel: ChannelInfo) -> None:
    counts = {len(message.senders), len(message.receivers), len(message.sequences)}
    optional = {len(message.reason), len(message.sizes), len(message.rows)}
    if len(counts) > 1 or not optional <= {0, len(message.senders)}:
        raise ValueError("columns of different lengths")
    _require_below(message.rows, len(message.says), "a payload")
    _require_below(message.reason, len(message.reasons), "a reason")
    for places in (message.senders, message.receivers, message.says):
        _require_roster(_array(places), channel)
    for said in message.said:
        if said.texts:
            if len(said.texts) != len(message.says) or said.values:
                raise ValueError(f"{len(said.texts)} texts for {len(message.says)} agents")
            for text in set(said.texts):
                read_json(text)
            continue
        # As Python integers, which do not overflow.
        size = len(message.says)
        for extent in said.shape:
            size *= extent
        if size != len(said.values) or len(said.shape) > 16 or max(said.shape, default=0) > len(said.values):
            raise ValueError(f"{len(said.values)} numbers of shape {list(said.shape)} for {len(message.says)} agents")


def _scan(message: Any, channel: ChannelInfo) -> None:
    count = len(message.poses) // 4
    if len(message.poses) != 4 * count or len(message.distances) != len(message.angles) * count:
        raise ValueError(f"{len(message.distances)} distances of {len(message.angles)} rays from {count} poses")
    if not len(message.rows) and channel.rows is not None and count != channel.rows:
        raise ValueError(f"scans of {count} of {channel.rows} agents")
    _require_rows(_array(message.rows), count, channel)


def _image(message: Any, channel: ChannelInfo) -> None:
    _require_rows(np.array([message.row]), 1, channel)
    if len(message.position) not in (0, 3) or len(message.target) not in (0, 3):
        raise ValueError("a camera without a position")
    png.size(message.data)


def _contact(message: Any, channel: ChannelInfo) -> None:
    if len(message.point) not in (0, 2, 3):
        raise ValueError(f"a point with {len(message.point)} coordinates")


def _specification(message: Any, channel: ChannelInfo) -> None:
    count = int(channel.metadata.get("count", "0"))
    rows, exact = list(message.rows), list(message.exact_rows)
    if any(row >= count for row in (*rows, *exact)):
        raise ValueError(f"row {max((*rows, *exact))} of {count}")
    if message.verdicts and len(message.verdicts) != (len(rows) or count):
        raise ValueError(f"{len(message.verdicts)} verdicts of {len(rows) or count} rows")
    if any(code > 5 for code in message.verdicts):
        raise ValueError(f"there is no verdict {max(message.verdicts)}")
    if any(len(each) not in (0, len(message.verdicts)) for each in (message.lower, message.upper)):
        raise ValueError("the interval is not that of the rows with verdicts")
    if len(message.robustness) != len(message.times) * (len(exact) or count):
        raise ValueError(f"{len(message.robustness)} numbers at {len(message.times)} instants")


_CHECKS: dict[str, Callable[[Any, ChannelInfo], None]] = {
    "Rows": _rows,
    "Specification": _specification,
    "SeriesRows": _series,
    "TableRows": _tables,
    "Awareness": _awareness,
    "Knowledge": _knowledge,
    "Event": _event,
    "Recurring": _recurring,
    "Message": _message,
    "MessageColumns": _message_columns,
    "Scan": _scan,
    "Image": _image,
    "Contact": _contact,
}
"""The check of each message, by its name."""


def _array(places: Sequence[int]) -> NDArray[np.uint32] | None:
    return np.array(places, np.uint32) if len(places) else None


def _require_width(values: NDArray[np.float64], channel: ChannelInfo) -> None:
    if channel.width is not None and values.shape[1] != channel.width:
        raise ValueError(f"{values.shape[1]} columns, where {channel.width} were announced")


def _require_rows(rows: NDArray[Any] | None, count: int, channel: ChannelInfo) -> None:
    """Check that there are as many values as rows, and that the rows ascend and are within the group."""
    if rows is not None and len(rows) != count and count:
        raise ValueError(f"{count} values for {len(rows)} rows")
    if rows is not None and len(rows) > 1 and not (rows[1:] > rows[:-1]).all():
        raise ValueError("rows that do not ascend")
    last = count - 1 if rows is None or not len(rows) else int(rows[-1])
    if last >= (_MOST_ROWS if channel.rows is None else channel.rows):
        raise ValueError(f"row {last} of a group of {channel.rows}")


def _require_roster(places: NDArray[np.uint32] | None, channel: ChannelInfo) -> None:
    if places is not None and len(places) and channel.roster is not None and int(places.max()) >= channel.roster:
        raise ValueError(f"index {places.max()} in a roster of {channel.roster}")


def _require_below(places: Sequence[int], count: int, what: str) -> None:
    if max(places, default=-1) >= count:
        raise ValueError(f"{what} that is not in the list")
