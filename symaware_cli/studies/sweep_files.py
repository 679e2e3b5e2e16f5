"""The files in the folder of a sweep. Light, because verbs ask whether a path is such a folder."""

from __future__ import annotations

import os
from pathlib import Path

SWEEP, WRITTEN, IDENTITY, SCENARIO = "sweep.yaml", "as-written.yaml", "identity.json", "scenario"
JOURNAL, TABLE, TIMES, LOGS = "journal.sqlite", "runs.parquet", "times.parquet", "logs"


def is_sweep(path: Path) -> bool:
    """Whether a path is the folder of a sweep; False for names that no file system takes as well."""
    return os.path.isfile(path / SWEEP) and os.path.isfile(path / IDENTITY)
