"""Writes logs anew with something changed: whole files with sound checksums, as a forger would."""

from collections.abc import Callable
from pathlib import Path

from symaware_cli import Log, open_log
from symaware_cli.recording.log_message import LogMessage
from symaware_cli.recording.writer import LogWriter


def altered(
    log: Path,
    path: Path,
    message: Callable[[LogMessage], bytes | None] = lambda message: message.data,
    attachment: Callable[[str, bytes], bytes] = lambda name, data: data,
) -> Log:
    """Write a log anew.

    Args:
        log: The log.
        path: Where.
        message: Returns the data of each message; None to leave it out.
        attachment: Returns the content of each attachment.
    """
    there = open_log(log)
    with LogWriter(path) as writer:
        for record in there.attachment_records():
            writer.attach(record.name, record.media_type, attachment(record.name, record.data))
        numbers = {"/timing": writer.timing}
        for channel in there.index.channels.values():
            if channel.topic not in numbers:
                schema = there.channels[channel.topic].schema.removeprefix("symaware.v1.")
                numbers[channel.topic] = writer.channel(channel.topic, schema, channel.metadata)
        for each in there.messages():
            data = message(each)
            if data is not None:
                writer.add(numbers[each.channel.topic], each.time, data)
        writer.finish(there.outcome or {})
    return open_log(path)
