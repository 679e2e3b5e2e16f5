"""A rosbridge with a node that misbehaves in the way named by the URL: `python ros_peers.py`, ws://127.0.0.1:PORT/KIND."""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Mapping
from typing import Any

from symaware_ros.peer import GoToGoal, Peer, listen
from websockets.sync.server import ServerConnection

#: The number of answers before a node misbehaves.
SOUND = 6


class Misbehaving(Peer):
    """Answers a few times on each connection, and then misbehaves in the way named by the path."""

    def __init__(self) -> None:
        super().__init__([GoToGoal((5.0, -1.0)), GoToGoal((5.0, 1.0))])
        self._counts: Counter[ServerConnection] = Counter()

    def on_odometry(
        self, connection: ServerConnection, topic: str, kinds: Mapping[str, str], odometry: Mapping[str, Any]
    ) -> None:
        self._counts[connection] += 1
        if self._counts[connection] <= SOUND:
            super().on_odometry(connection, topic, kinds, odometry)
            return
        still = {"linear": {"x": 0.0, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": 0.0}}
        match connection.request.path.strip("/") if connection.request else "":
            case "silent":
                return
            case "dead":
                os._exit(1)
            case "closing":
                connection.close()
            case "garbled":
                connection.send('{"op": "publish", "topic": ')
            case "nested":
                connection.send("[" * 100_000)
            case "binary":
                connection.send(b"\x00\x01")
            case "huge":
                connection.send("x" * (2 << 20))
            case "error":
                connection.send(json.dumps({"op": "status", "level": "error", "msg": "no such type"}))
            case "nan":
                still["linear"]["x"] = float("nan")
                self._send(connection, topic, still)
            case "null":
                self._send(connection, topic, {**still, "linear": {"x": None, "y": 0.0, "z": 0.0}})
            case "text":
                self._send(connection, topic, "stop")
            case "large":
                self._send(connection, topic, {**still, "linear": {"x": 10**400, "y": 0.0, "z": 0.0}})
            case "flood":
                for _ in range(200):
                    self._send(connection, topic, still)
            case "early":
                stamp = {"sec": 1000, "nanosec": 0}
                self._send(connection, topic, {"header": {"stamp": stamp}, "twist": still})
            case "stale":
                # Repeats an earlier answer, which only its stamp reveals.
                stamp = {"sec": 0, "nanosec": 0}
                self._send(connection, topic, {"header": {"stamp": stamp}, "twist": still})
                super().on_odometry(connection, topic, kinds, odometry)
            case "slow":
                time.sleep(0.2)
                super().on_odometry(connection, topic, kinds, odometry)

    def _send(self, connection: ServerConnection, topic: str, content: Any) -> None:
        connection.send(json.dumps({"op": "publish", "topic": topic, "msg": content}))


if __name__ == "__main__":
    listen(Misbehaving(), port=0)
