"""Messages of many agents that are recorded together."""

import csv

import numpy as np
import pytest
from simulating import Team, simulation

from symaware_cli import Delivery, MessageBatch, open_log
from symaware_cli.exporting.conversion import export_tables
from symaware_cli.exporting.text import CSV
from symaware_cli.network.traffic import Traffic
from symaware_cli.recording.error import LogError
from symaware_cli.recording.manifest import manifest
from symaware_cli.recording.recorder import Recorder
from symaware_cli.recording.writer import LogWriter


@pytest.fixture
def columns(tmp_path):
    """A log with two batches of messages in it."""
    ready = simulation({"robot": Team(count=3)})
    path = tmp_path / "log.mcap"
    with LogWriter(path) as writer:
        content = manifest(
            name="test",
            seed=1,
            mode="synchronous",
            steps=1,
            environment=ready.environment,
            groups=ready.groups,
            uses={"robot": {"model": "test", "components": {}}},
            indexed={"robot": True},
        )
        writer.attach("manifest.json", "application/json", content)
        recorder = Recorder(writer, ready.environment, ready.groups)
        said = {"goal": np.array([[1.0, 2.0], [3.0, 4.0]]), "risk": np.array([0.5, 0.25])}
        batch = MessageBatch(np.array([0, 2]), said)
        rows, receivers = np.array([0, 1, 1]), np.array([1, 0, 1])
        sent = Delivery(batch, rows, receivers, np.array([7, 0, 1]), 50, np.full(3, 50))
        sizes, reason = np.array([56, 56]), np.array([1, 2, 1], np.uint8)
        recorder.traffic(Traffic("sent", sent, sizes), 50)
        recorder.traffic(Traffic("dropped", sent, sizes, ("", "loss", "storm"), reason), 60)
        recorder.finish(60, 1, {"status": "finished"})
    return path


def test_messages_in_columns_read_like_single_ones(columns):
    entries = list(open_log(columns).communications())
    assert [(entry.time, entry.stage, entry.sender, entry.receiver, entry.id, entry.reason) for entry in entries] == [
        (50, "SENT", "robot.0", "robot.1", 7, ""),
        (50, "SENT", "robot.2", "robot.0", 2 << 32, ""),
        (50, "SENT", "robot.2", "robot.1", (2 << 32) + 1, ""),
        (60, "DROPPED", "robot.0", "robot.1", 7, "loss"),
        (60, "DROPPED", "robot.2", "robot.0", 2 << 32, "storm"),
        (60, "DROPPED", "robot.2", "robot.1", (2 << 32) + 1, "loss"),
    ]
    assert [entry.payload for entry in entries[:3]] == [
        {"goal": [1.0, 2.0], "risk": 0.5},
        {"goal": [3.0, 4.0], "risk": 0.25},
        {"goal": [3.0, 4.0], "risk": 0.25},
    ]
    assert {(entry.size, entry.sent_time, entry.kind, entry.latency) for entry in entries} == {
        (56, 50, "message", 0),
        (56, 50, "message", 10),
    }


def test_they_are_exported_like_single_ones(columns, tmp_path):
    export_tables(open_log(columns), tmp_path / "tables", CSV)
    with open(tmp_path / "tables" / "messages.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["sender"], row["receiver"], row["stage"], row["reason"]) for row in rows[2:4]] == [
        ("robot.2", "robot.1", "SENT", ""),
        ("robot.0", "robot.1", "DROPPED", "loss"),
    ]
    assert rows[0]["payload"] == '{"goal": [1.0, 2.0], "risk": 0.5}'


def test_columns_that_do_not_fit_together_are_damage(tmp_path):
    path = tmp_path / "damaged.mcap"
    with LogWriter(path) as writer:
        channel = writer.channel("/messages/columns", "MessageColumns")
        from symaware_cli.recording import symaware_v1_pb2 as v1

        writer.add(channel, 5, v1.MessageColumns(senders=[0, 1], receivers=[1], sequences=[0, 0]).SerializeToString())
        writer.finish({"status": "finished"})
    with pytest.raises(LogError, match=r"on /messages/columns in .* do not fit together: at 5 ns"):
        list(open_log(path).communications())
