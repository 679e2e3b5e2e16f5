"""Selection of events, messages and contacts."""

import json
from typing import Any

import pytest

from symaware_cli import Log
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.entry_filter import EntryFilter
from symaware_cli.log.error import UnknownNameError
from symaware_cli.log.reader import open_log
from symaware_cli.log.writer import LogWriter

EVENTS: list[tuple[str, str, Any, dict[str, Any]]] = [  # name, source, level, data
    ("started", "run", "INFO", {}),
    ("slowed", "agents.robot.1.steer", "DEBUG", {}),
    ("slowed", "agents.robot.10.steer", "INFO", {"agent": "robot.1"}),
    ("contact", "environment", "WARNING", {"first": "car", "second": "robot.1"}),
    ("tick", "agents.robot.steer", "INFO", {}),
    ("failed", "agents.car", "ERROR", {"step": 3}),
    ("later", "agents.car.steer", 17, {}),
]
MESSAGES = [  # sender, receiver, kind, stage
    ("robot.1", "car", "hello", "SENT"),
    ("car", "robot.10", "hello", "DELIVERED"),
    ("robot.10", "robot.2", "bye", "DROPPED"),
]
CONTACTS = [("car", "wall", "BEGIN"), ("robot.1", "wall", "END"), ("robot.1", "robot.2", "BEGIN")]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    robots = [f"robot.{row}" for row in range(11)]
    manifest = {
        "format": 1,
        "groups": {"robot": {"agents": robots}, "car": {"agents": ["car"]}},
        "entities": {"wall": {}},
    }
    with LogWriter(tmp_path_factory.mktemp("entries") / "log.mcap") as writer:
        writer.attach("manifest.json", "application/json", json.dumps(manifest).encode())
        entries = [
            *((v1.Event(name=n, source=s, level=lv, data=json.dumps(d)), "/events") for n, s, lv, d in EVENTS),
            *((v1.Message(sender=s, receiver=r, kind=k, stage=g), "/messages") for s, r, k, g in MESSAGES),
            *((v1.Contact(a=a, b=b, stage=g), "/contacts") for a, b, g in CONTACTS),
        ]
        channels = {topic: writer.channel(topic, topic.strip("/").title()[:-1]) for _, topic in reversed(entries)}
        numbered = [
            (place, *entry) for kind in channels for place, entry in enumerate(e for e in entries if e[1] == kind)
        ]
        for time, message, topic in sorted(numbered, key=lambda entry: entry[0]):
            writer.add(channels[topic], time, message.SerializeToString())
        writer.finish({})
    return open_log(writer.path)


@pytest.mark.parametrize(
    ("wanted", "times"),
    [
        ({}, [0, 1, 2, 3, 4, 5, 6]),
        ({"agents": ("robot.1",)}, [1, 2, 3]),
        ({"agents": ("robot.10",)}, [2]),
        ({"agents": ("robot",)}, [1, 2, 3, 4]),
        ({"agents": ("robot.*",)}, [1, 2, 3]),
        ({"agents": ("car",)}, [3, 5, 6]),
        ({"agents": ("car", "robot.10")}, [2, 3, 5, 6]),
        ({"agents": ("wall",)}, []),
        ({"agents": ("*",)}, [1, 2, 3, 4, 5, 6]),
        ({"name": "slowed"}, [1, 2]),
        ({"name": "s*"}, [0, 1, 2]),
        ({"name": "Slowed"}, []),
        ({"source": "agents.robot.*"}, [1, 2, 4]),
        ({"source": "agents.robot"}, []),
        ({"level": "DEBUG"}, [0, 1, 2, 3, 4, 5, 6]),
        ({"level": "INFO"}, [0, 2, 3, 4, 5, 6]),
        ({"level": "WARNING"}, [3, 5, 6]),
        ({"level": "ERROR"}, [5, 6]),
        ({"start": 2, "end": 4}, [2, 3, 4]),
        ({"start": 2, "end": 2}, [2]),
        ({"name": "slowed", "level": "INFO", "agents": ("robot.1",)}, [2]),
        # Conditions on messages do not matter to events.
        ({"kind": "nothing", "stage": "SENT"}, [0, 1, 2, 3, 4, 5, 6]),
    ],
)
def test_events_are_those_that_meet_every_condition(log: Log, wanted: dict[str, Any], times: list[int]) -> None:
    assert [event.time for event in EntryFilter(**wanted).events(log)] == times


@pytest.mark.parametrize(
    ("wanted", "times"),
    [
        ({}, [0, 1, 2]),
        ({"agents": ("car",)}, [0, 1]),
        ({"agents": ("robot.1",)}, [0]),
        ({"agents": ("robot",)}, [0, 1, 2]),
        ({"kind": "hello"}, [0, 1]),
        ({"kind": "*e"}, [2]),
        ({"stage": "DROPPED"}, [2]),
        ({"stage": "SENT", "kind": "hello", "end": 5}, [0]),
    ],
)
def test_messages_are_those_that_meet_every_condition(log: Log, wanted: dict[str, Any], times: list[int]) -> None:
    assert [entry.time for entry in EntryFilter(**wanted).communications(log)] == times


@pytest.mark.parametrize(
    ("wanted", "times"),
    [({}, [0, 1, 2]), ({"agents": ("wall",)}, [0, 1]), ({"agents": ("robot.2",)}, [2]), ({"stage": "END"}, [1])],
)
def test_contacts_are_those_that_meet_every_condition(log: Log, wanted: dict[str, Any], times: list[int]) -> None:
    assert [entry.time for entry in EntryFilter(**wanted).contacts(log)] == times


@pytest.mark.parametrize("pattern", ["robot.11", "robto", "x*", ""])
def test_an_unknown_agent_is_reported(log: Log, pattern: str) -> None:
    for find in (EntryFilter.events, EntryFilter.communications, EntryFilter.contacts):
        with pytest.raises(
            UnknownNameError, match=f"has no agent, group or entity '{pattern.replace('*', '.')}"
        ) as caught:
            list(find(EntryFilter(agents=("car", pattern)), log))
        assert {"robot", "robot.10", "car", "wall"} <= set(caught.value.known)
