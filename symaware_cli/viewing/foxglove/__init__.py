"""From a log to an MCAP of foxglove.* messages, which Foxglove shows without a plugin."""

from __future__ import annotations

import os
from collections.abc import Callable

from symaware_cli.recording.error import LogError
from symaware_cli.recording.output import whole_file
from symaware_cli.recording.reader import Log
from symaware_cli.viewing.views import run_view_of

_PROGRESS = 256
"""Messages between two reports of progress."""


def export_foxglove(
    log: Log, path: str | os.PathLike[str], on_progress: Callable[[int], None] | None = None
) -> dict[str, int]:
    """Write what Foxglove can show of a log.

    Args:
        log: The log. What is damaged in it is left out; `Log.damage` tells of it afterwards.
        path: The MCAP, which is replaced; it appears when it is complete.
        on_progress: Is told now and then which simulated time was reached [ns].

    Returns:
        How many messages were written on each topic.

    Raises:
        LogError: The log is not one of ours, or what this needs is not installed.
        OutputError: The MCAP cannot be written; nothing is left behind then.
    """
    run_view = run_view_of(log)
    try:
        from symaware_cli.viewing.foxglove.output import Output
        from symaware_cli.viewing.foxglove.scene import FoxgloveScene
    except ModuleNotFoundError as error:
        if not (error.name or "").startswith("foxglove_schemas_protobuf"):
            raise
        raise LogError(
            f"Foxglove needs the module `{error.name}`, which is not installed: pip install 'symaware-cli[export]'"
        ) from error
    with whole_file(path, log.path) as place, open(place, "wb") as file, Output(file) as output:
        show = FoxgloveScene(run_view, log.topics, output, log.start_time or 0)
        for number, message in enumerate(log.messages(show.topics)):
            if on_progress and number % _PROGRESS == 0:
                on_progress(message.time)
            try:
                show.take(message.channel.topic, message.time, message.decode())
            except (ValueError, IndexError, AttributeError) as error:
                raise LogError(
                    f"the message on {message.channel.topic} at {message.time} ns in {log.path} does not fit: {error}"
                ) from error
    return output.counts
