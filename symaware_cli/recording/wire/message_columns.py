"""Encodes the long columns of messages between agents."""

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
    """Encode the long columns of a `MessageColumns` message; its other fields may precede or follow them.

    Args:
        senders: (m,) indices in the roster.
        receivers: (m,) indices in the roster.
        sequences: (m,) the number of each message among those of its sender.
        reason: (m,) indices in the message's `reasons`; None if nothing was dropped.
        says: (s,) roster indices of the senders of payloads; None if payloads are not repeated.
        sizes: (m,) bytes; None if all are the same.
        rows: (m,) indices in `says`; None if no sender has several payloads.
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
