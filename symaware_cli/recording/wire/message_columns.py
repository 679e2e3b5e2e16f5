"""The long columns of messages between agents."""

from __future__ import annotations

from numpy.typing import ArrayLike

from symaware_cli.recording.wire.packing import INDEX, packed


def encode_message_columns(
    senders: ArrayLike,
    receivers: ArrayLike,
    sequences: ArrayLike,
    reason: ArrayLike | None = None,
    says: ArrayLike | None = None,
    sizes: ArrayLike | None = None,
    rows: ArrayLike | None = None,
) -> bytes:
    """Encode the long columns of a `MessageColumns` message; the rest of it may stand before or behind them.

    Args:
        senders: (m,) indices in the roster.
        receivers: (m,) indices in the roster.
        sequences: (m,) the number of each among those of its sender.
        reason: (m,) indices in the message's `reasons`; None if nothing was dropped.
        says: (s,) who says something, as indices in the roster; None if that is not repeated.
        sizes: (m,) bytes; None if all are the same.
        rows: (m,) places in `says`; None if nobody says several things.
    """
    return b"".join(
        (
            packed(5, senders, INDEX),
            packed(6, receivers, INDEX),
            packed(7, sequences, INDEX),
            b"" if reason is None else packed(9, reason, INDEX),
            b"" if says is None else packed(10, says, INDEX),
            b"" if sizes is None else packed(12, sizes, INDEX),
            b"" if rows is None else packed(13, rows, INDEX),
        )
    )
