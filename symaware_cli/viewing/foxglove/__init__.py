"""From a log to an MCAP of foxglove.* messages, which Foxglove shows without a plugin."""

from __future__ import annotations

import os
from collections.abc import Callable

from symaware_cli.recording.error import LogError
from symaware_cli.recording.output import whole_file
from symaware_cli.recording.reader import Log
from symaware_cli.viewing.detail import MANY, Detail
from symaware_cli.viewing.scene.scene import SCENE, TABLES, Scene
from symaware_cli.viewing.views import run_view_of

#: More agents than this have no names beside them, and shorter trails [s].
_TRAIL, _CROWD_TRAIL = 10.0, 3.0


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
        from symaware_cli.viewing.foxglove.show import show
        from symaware_cli.viewing.foxglove.stage import Stage
    except ModuleNotFoundError as error:
        if not (error.name or "").startswith("foxglove_schemas_protobuf"):
            raise
        raise LogError(
            f"Foxglove needs the module `{error.name}`, which is not installed: pip install 'symaware-cli[export]'"
        ) from error
    crowd = run_view.agent_count > MANY
    trail = _CROWD_TRAIL if crowd else _TRAIL
    # A person chooses there what to look at.
    detail = Detail(focus=(), labels=not crowd, minds=True, curves=True, trail=trail, single=False, words="")
    scene = Scene(run_view, detail, (*SCENE, *TABLES))
    with whole_file(path, log.path) as place, open(place, "wb") as file, Output(file) as output:
        stage = Stage(output)
        for chunk in scene.chunk_reader().chunks(log.messages()):
            try:
                for mark in scene.marks(chunk):
                    show(stage, mark)
            except (ValueError, IndexError, AttributeError) as error:
                raise LogError(f"what {log.path} tells up to {chunk.end} ns does not fit together: {error}") from error
            stage.flush()
            if on_progress:
                on_progress(chunk.end)
    return output.counts
