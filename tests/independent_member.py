"""A member written from docs/wire.md alone: sockets, the messages of transport.proto, and no part of the package.

`python independent_member.py TRANSPORT_PB2 HOST:PORT DIGEST VERSION KEY AGENT GOAL...` runs one agent of a group of
single integrators, which goes to its goal. KEY is hexadecimal, or empty. Prints the outcome of the run, as JSON.
"""

import hashlib
import hmac
import importlib.util
import json
import os
import socket
import struct
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any, Self

PROOF, FRAME, PING, PONG, FAREWELL = 1, 2, 3, 4, 5


class Wire:
    """A connection to the host."""

    def __init__(self, address: str, key: bytes = b"") -> None:
        host, _, port = address.rpartition(":")
        self.socket = socket.create_connection((host, int(port)), timeout=60.0)
        try:
            self._introduce(key)
        except BaseException:
            self.socket.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.socket.close()

    def _introduce(self, key: bytes) -> None:
        own = b"SYMAWARE" + bytes([1, 1 if key else 0]) + os.urandom(16)
        self.socket.sendall(own)
        other = self._exactly(26)
        assert other[:8] == b"SYMAWARE", other
        assert other[8:10] == bytes([1, 3 if key else 2]), other
        self.sealing: bytes | None = None
        self.opening: bytes | None = None
        self.sent = 0
        if key:
            secret = hmac.digest(hashlib.sha256(other + own).digest(), key, "sha256")
            self.opening = hmac.digest(secret, b"host\x01", "sha256")
            self.sealing = hmac.digest(secret, b"member\x01", "sha256")
            self.say(PROOF)
            kind, _ = self._record()
            assert kind == PROOF
        self.say(PING, struct.pack(">d", time.monotonic()))
        self.has_come = False
        while not self.has_come:
            self._listen()

    def _exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            part = self.socket.recv(count - len(data))
            if not part:
                raise EOFError("the host closed the connection")
            data += part
        return data

    def _record(self) -> tuple[int, bytes]:
        record = self._exactly(int.from_bytes(self._exactly(4), "big"))
        if self.opening:
            record, seal = record[:-32], record[-32:]
            assert hmac.compare_digest(hmac.digest(self.opening, record, "sha256"), seal)
            record = record[8:]
        return record[0], record[1:]

    def say(self, kind: int, content: bytes = b"") -> None:
        """Send a record."""
        record = bytes([kind]) + content
        if self.sealing:
            record = self.sent.to_bytes(8, "big") + record
            record += hmac.digest(self.sealing, record, "sha256")
            self.sent += 1
        self.socket.sendall(len(record).to_bytes(4, "big") + record)

    def _listen(self) -> bytes | None:
        kind, content = self._record()
        if kind == PING:
            now = struct.pack(">d", time.monotonic())
            self.say(PONG, content + now + now)
        elif kind == PONG:
            self.has_come = True
        elif kind == FAREWELL:
            raise EOFError(content.decode())
        elif kind == FRAME:
            return content
        return None

    def hear(self) -> bytes:
        """The next frame."""
        while (frame := self._listen()) is None:
            pass
        return frame


def array(wire: Any, kind: int, code: str, shape: Sequence[int], numbers: Sequence[float]) -> Any:
    """Numbers as an `Array`."""
    return wire.Array(type=kind, shape=shape, data=struct.pack(f"<{len(numbers)}{code}", *numbers))


def whole(array: Any) -> tuple[int, ...]:
    """The numbers of an `Array` of 64-bit whole numbers."""
    return struct.unpack(f"<{len(array.data) // 8}q", array.data)


def place(world: Mapping[str, Any], group: str, row: int) -> int:
    """The place of an agent in the roster: groups sorted by name, then rows."""
    sizes = {name.partition("/")[2]: each.shape[0] for name, each in world.items() if name.startswith("state/")}
    return int(sum(size for name, size in sizes.items() if name < group)) + row


def main(module: str, address: str, digest: str, version: str, key: str, agent: str, *goal: str) -> None:
    """Take part from the beginning to the end."""
    spec = importlib.util.spec_from_file_location("transport_pb2", module)
    assert spec is not None
    assert spec.loader is not None
    wire = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(wire)
    group, row = agent.partition(".")[0], int(agent.partition(".")[2] or 0)
    with Wire(address, bytes.fromhex(key)) as host:
        last = take_part(wire, host, digest, version, agent, group, row, [float(each) for each in goal])
    assert not any(name.startswith("symaware") for name in sys.modules)
    print(json.dumps(last))


def take_part(
    wire: Any, host: Wire, digest: str, version: str, agent: str, group: str, row: int, goal: Sequence[float]
) -> dict[str, Any]:
    """Run the agent until the host reports the end."""

    def say(**content: Any) -> None:
        host.say(FRAME, wire.Frame(**content).SerializeToString())

    hello = wire.Hello(name="independent", scenario=bytes.fromhex(digest), version=version, agents=[agent])
    say(hello=hello)
    told: list[str] = []
    steps: list[int] = []
    heard: list[list[int]] = []
    has_reached = False
    while True:
        frame = wire.Frame.FromString(host.hear())
        kind = frame.WhichOneof("content")
        told += [kind] if told[-1:] != [kind] else []
        if kind == "refusal":
            break
        if kind == "end":
            break
        if kind != "step":
            continue
        step = frame.step
        steps.append(step.step)
        world = {entry.name: entry.value.array for entry in map(wire.Entry.FromString, step.world)}
        states = world[f"state/{group}"]
        width = states.shape[1]
        position = struct.unpack(f"<{width}d", states.data[8 * width * row : 8 * width * (row + 1)])
        for each in map(wire.Delivery.FromString, step.deliveries):
            batch = wire.MessageBatch.FromString(step.batches[each.batch])
            rows, senders, due = map(whole, (each.rows, batch.senders, each.due))
            heard += [[senders[row], time] for row, time in zip(rows, due, strict=True)]
        way = [there - here for there, here in zip(goal, position, strict=True)]
        distance = sum(each * each for each in way) ** 0.5
        if distance < 0.1 and not has_reached:
            has_reached = True
            source = f"agents.{agent}.steer"
            say(notice=wire.Notice(name="goal-reached", source=source, level="INFO", text="reached its goal"))
        slowed = min(1.0, 1.0 / max(distance, 1e-9))
        mine_row = array(wire, wire.Array.INT64, "q", [1], [row])
        inputs = array(wire, wire.Array.FLOAT64, "d", [1, width], [2.0 * slowed * each for each in way])
        mine = wire.Input(group=group, rows=mine_row, inputs=inputs).SerializeToString()
        said = wire.Items(values=[wire.Value(text="hello").SerializeToString()])
        word = wire.Entry(name="word", value=wire.Value(list=said)).SerializeToString()
        sender = array(wire, wire.Array.INT64, "q", [1], [place(world, group, row)])
        batch = wire.MessageBatch(senders=sender, columns=[word], kind="word")
        posts = [wire.Post(batch=batch, time=step.time).SerializeToString()] if step.step == 0 else []
        say(report=wire.Report(step=step.step, inputs=[mine], posts=posts))
    last = getattr(frame, kind)
    status = last.status if kind == "end" else "refused"
    return {"status": status, "reason": last.reason, "told": told, "steps": steps, "heard": heard}


if __name__ == "__main__":
    main(*sys.argv[1:])
