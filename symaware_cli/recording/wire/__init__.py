"""Encodes and decodes the large messages of a log without a Python object per number.

The encoding equals that of the generated classes, byte for byte; a message with a different field layout is decoded
with the generated class.

Rows are indices in a group, ascending; `None` stands for every row in order.
"""

from symaware_cli.recording.wire.awareness import (
    WHOLE_WORLD,
    Awareness,
    OthersSeries,
    decode_awareness,
    encode_awareness,
    encode_others_series,
)
from symaware_cli.recording.wire.message_columns import encode_message_columns
from symaware_cli.recording.wire.rows import (
    Rows,
    SeriesRows,
    TableRows,
    decode_rows,
    decode_series,
    decode_tables,
    encode_rows,
    encode_series,
    encode_tables,
)

__all__ = [
    "WHOLE_WORLD",
    "Awareness",
    "OthersSeries",
    "Rows",
    "SeriesRows",
    "TableRows",
    "decode_awareness",
    "decode_rows",
    "decode_series",
    "decode_tables",
    "encode_awareness",
    "encode_message_columns",
    "encode_others_series",
    "encode_rows",
    "encode_series",
    "encode_tables",
]
