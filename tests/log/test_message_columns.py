"""Messages are recorded in batches."""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import CSV, export_tables
from simulating import Team, simulation

from symaware_cli import Delivery, MessageBatch, open_log
from symaware_cli.core.message import objects
from symaware_cli.engine.network.traffic import Traffic
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.error import LogError
from symaware_cli.log.manifest import manifest_of
from symaware_cli.log.recorder import Recorder
from symaware_cli.log.writer import LogWriter


@pytest.fixture
def log_of(tmp_path: Path) -> Callable[..., Path]:
    """Records traffic among three robots, each ten nanoseconds after the one before; the first at 50 ns."""

    def record(*traffic: Traffic) -> Path:
        ready = simulation({"robot": Team(count=3)})
        path = tmp_path / "log.mcap"
        with LogWriter(path) as writer:
            content = manifest_of(
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
            for place, each in enumerate(traffic):
                recorder.traffic(each, 50 + 10 * place)
            recorder.finish(100, 1, {"status": "finished"})
        return path

    return record


@pytest.fixture
def columns(log_of: Callable[..., Path]) -> Path:
    """A log with numbers in messages of two of the robots."""
    said = {"goal": np.array([[1.0, 2.0], [3.0, 4.0]]), "risk": np.array([0.5, 0.25])}
    batch = MessageBatch(np.array([0, 2]), said)
    rows, receivers = np.array([0, 1, 1]), np.array([1, 0, 1])
    sent = Delivery(batch, rows, receivers, np.array([7, 0, 1]), 50, np.full(3, 50))
    sizes, reason = np.array([56, 56]), np.array([1, 2, 1], np.uint8)
    return log_of(Traffic("sent", sent, sizes), Traffic("dropped", sent, sizes, ("", "loss", "storm"), reason))


def test_each_message_of_a_batch_is_an_entry(columns: Path) -> None:
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


def test_each_is_a_row_of_the_table(columns: Path, tmp_path: Path) -> None:
    export_tables(open_log(columns), tmp_path / "tables", CSV)
    with open(tmp_path / "tables" / "messages.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["sender"], row["receiver"], row["stage"], row["reason"]) for row in rows[2:4]] == [
        ("robot.2", "robot.1", "SENT", ""),
        ("robot.0", "robot.1", "DROPPED", "loss"),
    ]
    assert rows[0]["payload"] == '{"goal": [1.0, 2.0], "risk": 0.5}'


def test_content_of_messages_besides_numbers_is_recorded_unchanged(log_of: Callable[..., Path]) -> None:
    said = {"word": objects(["fire", "fire", {"at": [1, 2.5]}]), "count": objects([1, True, None])}
    batch = MessageBatch(np.array([1, 1, 2]), said, "word", np.array([0, 2, 0]))
    places, sequences = np.arange(3), np.array([4, 5, 0])
    assert batch.receivers is not None
    delivery = Delivery(batch, places, batch.receivers, sequences, 50, np.full(3, 100))
    sizes = np.array([44, 37, 50])
    path = log_of(Traffic("sent", delivery, sizes), Traffic("delivered", delivery.some(slice(1, 3)), sizes))
    assert [(each.stage, each.id, each.payload, each.size) for each in open_log(path).communications()] == [
        ("SENT", (1 << 32) + 4, {"word": "fire", "count": 1}, 44),
        ("SENT", (1 << 32) + 5, {"word": "fire", "count": True}, 37),
        ("SENT", 2 << 32, {"word": {"at": [1, 2.5]}, "count": None}, 50),
        ("DELIVERED", (1 << 32) + 5, None, 37),
        ("DELIVERED", 2 << 32, None, 50),
    ]


@pytest.mark.parametrize(
    "columns",
    [
        {"senders": [0, 1], "receivers": [1], "sequences": [0, 0]},
        {"senders": [0], "receivers": [1], "sequences": [0], "sizes": [1, 2]},
        {"senders": [0], "receivers": [1], "sequences": [0], "says": [0], "rows": [1]},
        {"says": [0], "said": [v1.MessageColumns.Said(name="a", texts=["1", "2"])]},
        {"says": [0], "said": [v1.MessageColumns.Said(name="a", texts=["no JSON"])]},
    ],
)
def test_columns_that_do_not_fit_together_are_damage(tmp_path: Path, columns: dict[str, Any]) -> None:
    path = tmp_path / "damaged.mcap"
    with LogWriter(path) as writer:
        channel = writer.channel("/messages", "MessageColumns")
        writer.add(channel, 5, v1.MessageColumns(**columns).SerializeToString())
        writer.finish({"status": "finished"})
    with pytest.raises(LogError, match=r"on /messages in .* do not fit together: at 5 ns"):
        list(open_log(path).communications())


def test_logs_of_earlier_versions_have_single_messages_and_those_of_groups_on_two_channels(
    log_of: Callable[..., Path], tmp_path: Path
) -> None:
    path = tmp_path / "former.mcap"
    attachments = open_log(log_of()).attachments
    with LogWriter(path) as writer:
        writer.attach("manifest.json", "application/json", attachments["manifest.json"])
        single, columns = writer.channel("/messages", "Message"), writer.channel("/messages/columns", "MessageColumns")
        sent = v1.Message(id=5, sender="robot.0", receiver="robot.1", kind="word", stage=v1.Message.SENT, sent_time=50)
        sent.payload, sent.size = '{"word": "fire"}', 16
        writer.add(single, 50, sent.SerializeToString())
        states = v1.MessageColumns(stage=v1.Message.SENT, kind="state", sent_time=50, size=40)
        states.senders[:], states.receivers[:], states.sequences[:], states.says[:] = [2], [0], [1], [2]
        states.said.add(name="speed", values=[1.5])
        writer.add(columns, 50, states.SerializeToString())
        writer.finish({"status": "finished"})
    expected = [("robot.0", 5, {"word": "fire"}, 16), ("robot.2", (2 << 32) + 1, {"speed": 1.5}, 40)]
    log = open_log(path)
    assert [(each.sender, each.id, each.payload, each.size) for each in log.communications()] == expected
    export_tables(log, tmp_path / "tables", CSV)
    with open(tmp_path / "tables" / "messages.csv", newline="") as file:
        assert [row["sender"] for row in csv.DictReader(file)] == ["robot.0", "robot.2"]
