"""Names that logs and tables give their content, beside further parts of awareness and signals of components."""

from __future__ import annotations

from symaware_cli.core import PARTS

TOPICS = {
    "world": "/world/{}/state",
    "pose": "/world/{}/pose",
    "joints": "/world/{}/joints",
    "control": "/world/{}/control",
    "control_requested": "/agents/{}/control",
} | {part.name: f"/agents/{{}}/{part.name}" for part in PARTS}
"""The topic of each field of `Log.series` that every log may have."""

FIELDS = tuple(TOPICS)
"""The fields of `Log.series`."""

KINDS = ("control", "knowledge", "awareness", "sensors", "world")
"""What `Recorder` can be told to leave out."""

TABLES = (
    *(part.name for part in PARTS),
    *("world", "control", "awareness", "knowledge"),
    *("scan", "image", "measurement", "events", "recurring", "messages", "contacts", "timing"),
)
"""What there are tables of, beside those of who takes part."""
