"""The file names in a sweep folder. Imports little, because verbs check whether a path is such a folder."""

from __future__ import annotations

import os
from pathlib import Path

SWEEP, WRITTEN, IDENTITY, SCENARIO = "sweep.yaml", "as-written.yaml", "identity.json", "scenario"
JOURNAL, TABLE, TIMES, LOGS = "journal.sqlite", "runs.parquet", "times.parquet", "logs"


def is_sweep(path: Path) -> bool:
    """Return whether a path is a sweep folder; False also for names that are invalid in any file system."""
    return os.path.isfile(path / SWEEP) and os.path.isfile(path / IDENTITY)
