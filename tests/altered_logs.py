"""Writes logs anew with something changed: whole files with sound checksums, as a forger would."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from symaware_cli import Log, open_log
from symaware_cli.log.log_message import LogMessage
from symaware_cli.log.writer import LogWriter


def altered(
    log: Path,
    path: Path,
    message: Callable[[LogMessage], bytes | None] = lambda message: message.data,
    attachment: Callable[[str, bytes], bytes] = lambda name, data: data,
    outcome: Callable[[dict[str, Any]], dict[str, Any]] = lambda content: content,
    metadata: Callable[[str, dict[str, str]], dict[str, str]] = lambda topic, content: content,
) -> Log:
    """Write a log anew.

    Args:
        log: The log.
        path: The path of the new log.
        message: Returns the data of each message; None to leave it out.
        attachment: Returns the content of each attachment.
        outcome: Returns the outcome.
        metadata: Returns the metadata of each channel about columns.
    """
    there = open_log(log)
    with LogWriter(path) as writer:
        for record in there.attachment_records():
            writer.attach(record.name, record.media_type, attachment(record.name, record.data))
        numbers = {"/timing": writer.timing}
        for channel in there.index.channels.values():
            if channel.topic not in numbers:
                schema = there.channels[channel.topic].schema.removeprefix("symaware.v1.")
                numbers[channel.topic] = writer.channel(
                    channel.topic, schema, metadata(channel.topic, dict(channel.metadata))
                )
        for each in there.messages():
            data = message(each)
            if data is not None:
                writer.add(numbers[each.channel.topic], each.time, data)
        writer.finish(outcome(dict(there.outcome or {})))
    return open_log(path)
