"""Logs to export: of a real run, and put together message by message."""

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import pyarrow
import pytest
from exported import PARQUET, export_tables
from pyarrow import parquet
from sensing_log import write_sensing

from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log.reader import open_log
from symaware_cli.log.writer import LogWriter


@pytest.fixture(scope="session")
def noisy(scenarios: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of three agents that know how unsure they are of themselves and of each other."""
    path = tmp_path_factory.mktemp("noisy") / "noisy.mcap"
    execute(build(scenarios / "noisy.yaml", ["run.duration=2"], None), path)
    return path


@pytest.fixture(scope="session")
def sensing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of all that sensors measure."""
    return write_sensing(tmp_path_factory.mktemp("sensing") / "sensing.mcap")


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write a log of one group of three, out of (time, message) on /agents/robot/<field>."""

    def write(
        field: str,
        message_name: str,
        entries: Iterable[tuple[int, bytes]],
        metadata: Mapping[str, str] | None = None,
        group: str = "robot",
    ) -> Path:
        with LogWriter(tmp_path / "log.mcap") as writer:
            agents = [f"{group}.0", f"{group}.1", f"{group}.2"]
            manifest = {"format": 1, "groups": {group: {"agents": agents}}, "entities": {}, "roster": agents}
            writer.attach("manifest.json", "application/json", json.dumps(manifest).encode())
            channel = writer.channel(f"/agents/{group}/{field}", message_name, metadata)
            for time, data in entries:
                writer.add(channel, time, data)
            writer.finish({})
        return writer.path

    return write


@pytest.fixture
def table(tmp_path: Path) -> Callable[[Path, str], pyarrow.Table]:
    """Export a log, and read one of its tables back."""

    def table(log: Path, name: str) -> pyarrow.Table:
        export_tables(open_log(log), tmp_path / "tables", PARQUET)
        return parquet.read_table(tmp_path / "tables" / f"{name}.parquet", partitioning=None)

    return table
