"""A run as a bag, in the formats that ROS 2 writes."""

from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.views import installed_format


@pytest.fixture(scope="session")
def recorded(scenarios: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the log `floor.mcap`, the bag `bag`, and the same bag as a database, `bag.db3`."""
    folder = tmp_path_factory.mktemp("recorded")
    execute(build(scenarios / "floor.yaml", ["run.duration=2"], None), folder / "floor.mcap")
    installed_format("rosbag2").export(open_log(folder / "floor.mcap"), folder / "bag")
    store = get_typestore(Stores.ROS2_JAZZY)
    with (
        Reader(folder / "bag") as reader,
        Writer(folder / "sqlite", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer,
    ):
        copies = {
            each.topic: writer.add_connection(each.topic, each.msgtype, typestore=store) for each in reader.connections
        }
        for connection, time, data in reader.messages():
            writer.write(copies[connection.topic], time, data)
    (folder / "sqlite" / "sqlite.db3").rename(folder / "bag.db3")
    return folder
