"""Exports a log as an MCAP file of foxglove.* messages, which Foxglove shows without an extension."""

from __future__ import annotations

import os
from collections.abc import Callable

from symaware_cli.recording.error import LogError
from symaware_cli.recording.output import whole_file
from symaware_cli.recording.reader import Log
from symaware_cli.viewing.detail import MANY, Detail
from symaware_cli.viewing.scene.curves import NumberTables
from symaware_cli.viewing.scene.drawings import SCENE
from symaware_cli.viewing.scene.scene import Scene
from symaware_cli.viewing.views import run_view_of

#: Duration of trails, and for many agents, which also have no labels [s].
_TRAIL, _CROWD_TRAIL = 10.0, 3.0


def export_foxglove(
    log: Log, path: str | os.PathLike[str], on_progress: Callable[[int], None] | None = None
) -> dict[str, int]:
    """Write everything in a log that Foxglove can show.

    Args:
        log: The log. Damaged parts are skipped and reported by `Log.damage`.
        path: The MCAP file, which is replaced; it appears when it is complete.
        on_progress: Called at intervals with the simulated time reached [ns].

    Returns:
        The number of messages on each topic.

    Raises:
        LogError: The log is foreign, or a required module is not installed.
        OutputError: The file cannot be written; nothing is left behind then.
    """
    run_view = run_view_of(log)
    try:
        from symaware_cli.viewing.foxglove.output import Output, SceneUpdates
        from symaware_cli.viewing.foxglove.show import show
    except ModuleNotFoundError as error:
        if not (error.name or "").startswith("foxglove_schemas_protobuf"):
            raise
        raise LogError(
            f"Foxglove needs the module `{error.name}`, which is not installed: pip install 'symaware-cli[export]'"
        ) from error
    crowd = run_view.agent_count > MANY
    trail = _CROWD_TRAIL if crowd else _TRAIL
    # In Foxglove, users choose what to show.
    detail = Detail(focus=(), labels=not crowd, awareness=True, curves=True, trail=trail, single=False, words="")
    scene = Scene(run_view, detail, (*SCENE, NumberTables))
    with whole_file(path, log.path) as place, open(place, "wb") as file, Output(file) as output:
        updates = SceneUpdates(output)
        for chunk in scene.chunk_reader().chunks(log.messages()):
            try:
                for mark in scene.marks(chunk):
                    show(updates, mark)
            except (ValueError, IndexError, AttributeError) as error:
                raise LogError(f"{log.path} is inconsistent up to {chunk.end} ns: {error}") from error
            updates.flush()
            if on_progress:
                on_progress(chunk.end)
    return output.counts
