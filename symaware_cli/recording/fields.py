"""The fields of `Log.series`, and where each stands in a log."""

TOPICS = {
    "world": "/world/{}/state",
    "pose": "/world/{}/pose",
    "joints": "/world/{}/joints",
    "control": "/world/{}/control",
    "control_requested": "/agents/{}/control",
} | {name: f"/agents/{{}}/{name}" for name in ("state", "intent", "uncertainty", "risk")}
"""The topic of each field of `Log.series`."""

FIELDS = tuple(TOPICS)
"""The fields of `Log.series`, beside the sensors that measure numbers."""
