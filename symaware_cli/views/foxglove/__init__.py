"""Exports a log as an MCAP file of foxglove.* messages, which Foxglove shows without an extension."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import ClassVar

from symaware_cli.log import Log, LogError
from symaware_cli.views.detail import MANY, Detail
from symaware_cli.views.exporting.export_format import Exported, ExportFormat, Progress
from symaware_cli.views.exporting.log_selection import Selection
from symaware_cli.views.scene.scene import scene_of
from symaware_cli.views.views import run_view_of

#: Duration of trails, and for many agents, which also have no labels [s].
_TRAIL, _CROWD_TRAIL = 10.0, 3.0


class FoxgloveFile(ExportFormat):
    """An MCAP file for Foxglove, with everything in a log that Foxglove can show."""

    suffix: ClassVar = ".mcap"
    requires: ClassVar = {"foxglove_schemas_protobuf": "pip install 'symaware-cli[export]'"}
    selects: ClassVar = False

    def write(self, log: Log, place: Path, selection: Selection, on_progress: Progress) -> Exported:
        """Write the messages."""
        from symaware_cli.views.foxglove.output import Output, SceneUpdates
        from symaware_cli.views.foxglove.show import show

        run_view = run_view_of(log)
        crowd = run_view.agent_count > MANY
        trail = _CROWD_TRAIL if crowd else _TRAIL
        # In Foxglove, users choose what to show.
        detail = Detail(focus=(), labels=not crowd, awareness=True, curves=True, trail=trail, single=False, words="")
        scene = scene_of(run_view, detail, "foxglove")
        with open(place, "wb") as file, Output(file) as output:
            updates = SceneUpdates(output)
            for chunk in scene.chunk_reader().chunks(log.messages()):
                try:
                    scene.draw(chunk, partial(show, updates))
                except (ValueError, IndexError, AttributeError) as error:
                    raise LogError(f"{log.path} is inconsistent up to {chunk.end} ns: {error}") from error
                updates.flush()
                if on_progress:
                    on_progress(chunk.end)
        topics = dict(sorted(output.counts.items()))
        size = place.stat().st_size
        return Exported(
            [(topic, count, None) for topic, count in topics.items()],
            ("topic", "messages"),
            size,
            {"topics": topics, "size": size},
        )
