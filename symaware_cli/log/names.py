"""Names of fields, kinds and tables in logs, apart from additional parts of awareness and signals."""

from __future__ import annotations

from symaware_cli.awareness import PARTS

TOPICS = {
    "world": "/world/{}/state",
    "pose": "/world/{}/pose",
    "joints": "/world/{}/joints",
    "applied_control": "/world/{}/control",
    "requested_control": "/agents/{}/control",
} | {part.name: f"/agents/{{}}/{part.name}" for part in PARTS}
"""The topic of each field of `Log.series` that any log may have."""

INPUTS = "/inputs"
"""The topic of the external inputs of components."""

FIELDS = tuple(TOPICS)
"""The fields of `Log.series`."""

KINDS = ("control", "requested_control", "applied_control", "knowledge", "awareness", "sensors", "world")
"""The kinds of records that `Recorder` can omit; `control` stands for the requested and the applied control inputs."""

TABLES = (
    *(part.name for part in PARTS),
    *("world", "control", "awareness", "knowledge"),
    *("scan", "image", "measurement", "events", "recurring", "messages", "contacts", "timing"),
)
"""The tables that can be exported, apart from those of the participants."""
