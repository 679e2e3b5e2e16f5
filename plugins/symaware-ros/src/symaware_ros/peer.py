"""A stand-in for a rosbridge and a node that drives robots to their goals: `python -m symaware_ros.peer`.

The program needs no ROS. It supports the operations that `ros.control` uses: `advertise`, `subscribe` and `publish` of
rosbridge v2. Runs may connect one after the other.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import signal
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

ODOMETRY = "/odom"
COMMAND = "/cmd_vel"

Node = Callable[[Mapping[str, Any]], Mapping[str, Any]]
"""Returns the Twist that answers an Odometry, both in JSON."""


class GoToGoal:
    """A node that turns to its goal and drives there."""

    def __init__(self, goal: Sequence[float], speed: float = 1.0) -> None:
        """Store the goal, x and y [m], and the greatest speed [m/s]."""
        self._goal, self._speed = goal, speed

    def __call__(self, odometry: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the command that answers an odometry."""
        pose = odometry["pose"]["pose"]
        x, y = (self._goal[place] - pose["position"][axis] for place, axis in enumerate("xy"))
        heading = 2.0 * math.atan2(pose["orientation"]["z"], pose["orientation"]["w"])
        error = math.remainder(math.atan2(y, x) - heading, 2.0 * math.pi)
        distance = math.hypot(x, y)
        if distance < 0.05:
            return twist(0.0, 0.0)
        return twist(min(self._speed, distance) * max(math.cos(error), 0.0), 2.0 * error)


def twist(speed: float, turn_rate: float) -> dict[str, Any]:
    """Return a Twist of a speed [m/s] and a turn rate [rad/s]."""
    return {"linear": {"x": speed, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": turn_rate}}


class Peer:
    """Serves connections: answers each odometry on a topic that ends in ``/odom`` on the ``/cmd_vel`` beside it."""

    def __init__(self, nodes: Sequence[Node], delay: float = 0.0) -> None:
        """Prepare.

        Args:
            nodes: The nodes, assigned to topics in the order of subscription; further topics begin with the first node
                again.
            delay: The longest random wall time until an answer [s].
        """
        self._nodes, self._delay = nodes, delay

    def __call__(self, connection: ServerConnection) -> None:
        """Serve one connection until it is closed."""
        kinds: dict[str, str] = {}
        try:
            for frame in connection:
                said = json.loads(frame)
                if said["op"] == "subscribe":
                    kinds[said["topic"]] = said["type"]
                elif said["op"] == "publish" and said["topic"].endswith(ODOMETRY):
                    self.on_odometry(connection, said["topic"].removesuffix(ODOMETRY) + COMMAND, kinds, said["msg"])
        except ConnectionClosed:
            return

    def on_odometry(
        self, connection: ServerConnection, topic: str, kinds: Mapping[str, str], odometry: Mapping[str, Any]
    ) -> None:
        """Answer an odometry on a topic for commands, in the requested type."""
        if topic not in kinds:
            return
        if self._delay:
            time.sleep(random.uniform(0.0, self._delay))
        command = self._nodes[list(kinds).index(topic) % len(self._nodes)](odometry)
        if kinds[topic].endswith("Stamped"):
            command = {"header": {"stamp": odometry["header"]["stamp"], "frame_id": ""}, "twist": command}
        connection.send(json.dumps({"op": "publish", "topic": topic, "msg": command}))


def listen(peer: Peer, host: str = "127.0.0.1", port: int = 9090) -> None:
    """Serve until SIGINT or SIGTERM, and print the address."""
    with serve(peer, host, port, compression=None) as server:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: sys.exit(0))
        print(f"listens at ws://{host}:{server.socket.getsockname()[1]}", flush=True)
        server.serve_forever()


def main() -> None:
    """Serve with the settings of the command line."""
    parser = argparse.ArgumentParser(prog="python -m symaware_ros.peer", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--goal",
        nargs=2,
        type=float,
        action="append",
        metavar=("X", "Y"),
        help="a goal [m], of one robot after the other",
    )
    parser.add_argument("--delay", type=float, default=0.0, help="longest random wall time until an answer [s]")
    parser.add_argument("--port", type=int, default=9090, help="0 for any that is free")
    parser.add_argument("--bind", default="127.0.0.1", help="the address to listen at; by default this machine alone")
    arguments = parser.parse_args()
    nodes = [GoToGoal(goal) for goal in arguments.goal or [(5.0, 0.0)]]
    listen(Peer(nodes, arguments.delay), arguments.bind, arguments.port)


if __name__ == "__main__":
    main()
