"""A client of a rosbridge, a server through which programs without ROS publish and subscribe.

The protocol is rosbridge v2: objects in JSON over a WebSocket
(https://github.com/RobotWebTools/rosbridge_suite/blob/ros2/ROSBRIDGE_PROTOCOL.md).
"""

from __future__ import annotations

import json
import socket
import time
import weakref
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from ipaddress import ip_address
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.sync.client import ClientConnection, connect

MOST_BYTES = 1 << 20
"""The greatest frame that is accepted [bytes]; a command has a few hundred."""

_RETRY = 0.05
_CLOSING = 1.0
_LARGE_FRAME = 1009  # RFC 6455, section 7.4.1


class RosbridgeError(RuntimeError):
    """There is no rosbridge, it closes the connection, or it violates the protocol."""


class Published(NamedTuple):
    """A message on a topic.

    Attributes:
        topic: The topic.
        kind: The type of the message, such as ``nav_msgs/msg/Odometry``.
        content: The message in JSON.
    """

    topic: str
    kind: str
    content: Any


def is_loopback(url: str) -> bool:
    """Whether the server of a URL is on this machine, by its address or as localhost.

    Raises:
        ValueError: The text is no URL of a WebSocket.
    """
    parts = urlsplit(url)
    if parts.scheme not in ("ws", "wss") or not parts.hostname or parts.username is not None:
        raise ValueError("it has to begin with ws:// or wss:// and name a host, such as ws://127.0.0.1:9090")
    _ = parts.port  # the attribute raises its own error
    if parts.hostname == "localhost":
        return True
    try:
        return ip_address(parts.hostname).is_loopback
    except ValueError:
        return False


class Rosbridge:
    """A connection to a rosbridge.

    Attributes:
        url: The URL of the rosbridge.
        heard: The wall time of the last message, or of the connection [s].
        close: Closes the connection; may be called repeatedly.
    """

    def __init__(self, url: str, timeout: float) -> None:
        """Connect, and retry while nothing listens at the URL.

        Args:
            url: The URL.
            timeout: The longest wall time to try [s].

        Raises:
            RosbridgeError: There is no rosbridge.
        """
        self.url = url
        self._subscribed: set[str] = set()
        self._advertised: set[str] = set()
        stack = ExitStack()
        #: Closes the connection, at the latest when this object is no longer referenced.
        self.close = weakref.finalize(self, _close, stack)
        self._connection = _connected(url, timeout, stack)
        self.heard = time.monotonic()

    def advertise(self, topics: Iterable[Published]) -> bool:
        """Announce topics that were not announced before, and return whether there are any."""
        new = {each.topic: each for each in topics if each.topic not in self._advertised}
        for each in new.values():
            self._send({"op": "advertise", "topic": each.topic, "type": each.kind})
        self._advertised |= new.keys()
        return bool(new)

    def subscribe(self, topic: str, kind: str) -> None:
        """Ask for the messages on a topic."""
        self._send({"op": "subscribe", "topic": topic, "type": kind})
        self._subscribed.add(topic)

    def publish(self, message: Published) -> None:
        """Send a message.

        Raises:
            RosbridgeError: The connection is closed.
        """
        self._send({"op": "publish", "topic": message.topic, "msg": message.content})

    def receive(self, deadline: float) -> tuple[str, Any] | None:
        """Return topic and content of the next message on the subscribed topics.

        Args:
            deadline: The wall time until which to wait, as of `time.monotonic` [s].

        Returns:
            The message; None if none arrived.

        Raises:
            RosbridgeError: The connection is closed, or the rosbridge violates the protocol.
        """
        while True:
            try:
                frame = self._connection.recv(timeout=max(0.0, deadline - time.monotonic()))
            except TimeoutError:
                return None
            except ConnectionClosed as error:
                raise RosbridgeError(f"{self.url} {_how_it_closed(error)}") from error
            found = self._message(frame)
            if found is not None:
                self.heard = time.monotonic()
                return found

    def _message(self, frame: str | bytes) -> tuple[str, Any] | None:
        """Return topic and content of a message on a subscribed topic; None for other frames."""
        try:
            said = json.loads(frame) if isinstance(frame, str) else None
        except (ValueError, RecursionError):
            said = None
        if not isinstance(said, dict) or not isinstance(said.get("op"), str):
            raise RosbridgeError(f"{self.url} sent a frame that violates its protocol: {frame[:60]!r}")
        if said["op"] == "status" and said.get("level") == "error":
            raise RosbridgeError(f"{self.url} reports an error: {str(said.get('msg'))[:300]}")
        if said["op"] != "publish" or not isinstance(said.get("topic"), str) or said["topic"] not in self._subscribed:
            return None
        return said["topic"], said.get("msg")

    def _send(self, said: Any) -> None:
        try:
            self._connection.send(json.dumps(said, allow_nan=False))
        except ConnectionClosed as error:
            raise RosbridgeError(f"{self.url} {_how_it_closed(error)}") from error


def _close(stack: ExitStack) -> None:
    with suppress(Exception):  # the reply of the other end is not needed any more
        stack.close()


def _connected(url: str, timeout: float, stack: ExitStack) -> ClientConnection:
    """Connect, and register closing of the connection with a stack."""
    deadline = time.monotonic() + timeout
    while True:
        remaining = max(deadline - time.monotonic(), _RETRY)
        try:
            opened = stack.enter_context(_opened(url, remaining))
        except OSError as error:
            if time.monotonic() > deadline:
                raise RosbridgeError(
                    f"there is no rosbridge at {url} ({error.strerror or error}): start it, for example with "
                    "`ros2 launch rosbridge_server rosbridge_websocket_launch.xml` or `python -m symaware_ros.peer`"
                ) from error
            time.sleep(_RETRY)
            continue
        # An own socket avoids proxies and redirections, so that the connection leads to the host of the URL.
        making = connect(
            url,
            sock=opened,
            proxy=None,
            compression=None,
            open_timeout=remaining,
            close_timeout=_CLOSING,
            ping_interval=None,
            max_size=MOST_BYTES,
        )
        try:
            return stack.enter_context(making)
        except (WebSocketException, OSError, EOFError, ValueError) as error:
            raise RosbridgeError(f"the server at {url} is no rosbridge: {error}") from error


def _opened(url: str, timeout: float) -> socket.socket:
    parts = urlsplit(url)
    port = parts.port or (443 if parts.scheme == "wss" else 80)
    return socket.create_connection((parts.hostname, port), timeout)


def _how_it_closed(error: ConnectionClosed) -> str:
    if error.sent is not None and error.sent.code == _LARGE_FRAME:
        return f"sent a frame of more than {MOST_BYTES:,} bytes"
    return "has closed the connection"
