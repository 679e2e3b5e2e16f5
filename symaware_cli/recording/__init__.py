"""The log of a run: one MCAP file of protobuf messages (docs/log-format.md).

Nothing is imported here, so that whoever needs one side pays for one side:

- `writer.LogWriter` writes a log, `wire` encodes its big messages,
- `reader.open_log` reads one, `recovery` what is left of a broken one, `repair.recover` makes that sound,
- `process_log` and `merging` make one log of those of several processes,
- `entry_filter` finds what happened, `overview` sums a log up, `digest.digest` compares runs,
- `output` writes files that appear whole or not at all.
"""
