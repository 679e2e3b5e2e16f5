"""A log of every kind of message, written by the real writer."""

import json
from pathlib import Path

import numpy as np
from google.protobuf.message import Message as ProtobufMessage

from symaware_cli.log import others_message, wire
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.writer import LogWriter

MANIFEST = {
    "format": 1,
    "name": "sample",
    "seed": 7,
    "mode": "synchronous",
    "time_step": 50_000_000,
    "steps": 40,
    "groups": {
        "robot": {"agents": ["robot.0", "robot.1", "robot.2"], "indexed": True},
        "car": {"agents": ["car"], "indexed": False},
    },
    "entities": {"wall": {}},
    "roster": ["robot.0", "robot.1", "robot.2", "car", "wall"],
}
STEP = 50_000_000


def write_sample(path: Path, *, steps: int = 40, flush_every: int = 5, end: str = "finish") -> Path:
    """Write a log in which every kind of message occurs; its data do not depend on `flush_every`."""
    random = np.random.default_rng(7)
    writer = LogWriter(path)
    writer.attach("manifest.json", "application/json", json.dumps(MANIFEST).encode())
    writer.attach("scenario/hello.yaml", "application/yaml", b"symaware: 1\nname: sample\n")
    writer.attach("resolved.yaml", "application/yaml", b"symaware: 1\nname: sample\nseed: 7\n")
    writer.attach("versions.json", "application/json", json.dumps({"flush_every": flush_every}).encode())
    planar = {"columns": "x,y,heading", "units": "m,m,rad"}
    world = writer.channel("/world/robot/state", "Rows", planar)
    state = writer.channel("/agents/robot/state", "Rows", planar)
    car = writer.channel("/agents/car/state", "Rows", planar)
    inputs = {"columns": "speed,turn", "units": "m/s,rad/s"}
    control = writer.channel("/agents/robot/control", "Rows", inputs)
    applied = writer.channel("/world/robot/control", "Rows", inputs)
    risk = writer.channel("/agents/robot/risk", "SeriesRows", {"columns": "risk", "units": "1"})
    awareness = writer.channel("/agents/robot/awareness", "Awareness")
    knowledge = writer.channel("/agents/robot/knowledge", "Knowledge")
    events = writer.channel("/events", "Event")
    messages = writer.channel("/messages", "Message")
    contacts = writer.channel("/contacts", "Contact")

    def entry(message: ProtobufMessage) -> bytes:
        return message.SerializeToString(deterministic=True)

    writer.add(knowledge, 0, entry(v1.Knowledge(values=['{"goal": [1, 2]}', "{}", "{}"])))
    for step in range(steps):
        now = step * STEP
        truth = random.normal(size=(3, 3))
        writer.add(world, now, wire.encode_rows(truth))
        writer.add(state, now, wire.encode_rows(truth) if step % 2 == 0 else wire.encode_rows(truth[[1]], [1]))
        writer.add(car, now, wire.encode_rows(random.normal(size=(1, 3))))
        requested = random.normal(size=(3, 2))
        writer.add(control, now, wire.encode_rows(requested))
        writer.add(applied, now, wire.encode_rows(requested.clip(-1, 1)))
        writer.add(risk, now, wire.encode_series([now, now + STEP], random.random((3, 2, 1))))
        writer.add(awareness, now, others_message.WHOLE_WORLD)
        if step % 10 == 3:
            event = v1.Event(name="computed", source="agents.robot.1.steer", level=v1.Event.INFO, data='{"step": 3}')
            writer.add(events, now, entry(event))
            sent = v1.Message(id=step, sender="robot.0", receiver="car", kind="hello", stage=v1.Message.SENT)
            sent.sent_time, sent.payload = now, '{"text": "hello"}'
            writer.add(messages, now, entry(sent))
            writer.add(
                contacts, now, entry(v1.Contact(a="car", b="wall", point=[1, 2], depth=0.1, stage=v1.Contact.BEGIN))
            )
        if step % 10 == 4:
            told = v1.Message(id=step - 1, sender="robot.0", receiver="car", kind="hello", stage=v1.Message.DELIVERED)
            told.sent_time = now - STEP
            writer.add(messages, now, entry(told))
        if step % flush_every == flush_every - 1:
            writer.add_timing(now, wall_time=step * 0.001 * flush_every, cpu_time=0.0, steps=step)
            writer.flush()
    if end == "finish":
        writer.finish({"status": "done", "steps": steps})
    elif end == "abort":
        writer.abort()
    else:
        writer.flush()
        writer._file.close()
    return path
