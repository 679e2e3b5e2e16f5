"""Ports for servers that tests start."""

import random
import socket

#: Below what systems give to those who connect, so that nobody is given one while a test has let go of it.
_RANGE = range(15_000, 30_000)


def free_port() -> int:
    """A port of the loopback that nobody listens at."""
    while True:
        port = random.choice(_RANGE)
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
