"""A real log, written by the real writer."""

from pathlib import Path

import pytest
from sample_log import write_sample


@pytest.fixture
def sample(tmp_path: Path) -> Path:
    """A finished log of 40 steps in 8 chunks."""
    return write_sample(tmp_path / "sample.mcap")
