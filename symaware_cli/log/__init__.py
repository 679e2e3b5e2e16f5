"""Logs of runs: MCAP files of protobuf messages (docs/log-format.md).

Nothing is imported here, so that users of the reader do not pay for the writer, and vice versa:

- `writer.LogWriter` writes a log, `wire` encodes its large messages,
- `reader.open_log` reads one, `recovery` reads the intact part of a damaged one, `repair.recover` writes a sound copy,
- `entry_filter` selects events and messages, `overview` summarises a log, `digest.digest` compares runs,
- `data_frames` makes frames of pandas, Polars and Arrow from series,
- `output` writes files atomically.
"""

from symaware_cli.interface import interface_of

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
