"""Real logs, written by the real writer."""

from collections.abc import Callable
from pathlib import Path

import pytest
from sample_log import write_sample


@pytest.fixture
def sample(tmp_path: Path) -> Path:
    """A finished log of 40 steps in 8 chunks."""
    return write_sample(tmp_path / "sample.mcap")


@pytest.fixture(scope="session")
def sample_writer() -> Callable[..., Path]:
    """`write_sample` itself, for logs with other endings."""
    return write_sample
