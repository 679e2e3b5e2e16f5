"""The transport ``memory``, which connects no processes."""

from __future__ import annotations

from symaware_cli.processes.transport import Port, Transport, TransportError


class Memory(Transport):
    """The whole run within one process: simulated messages, nothing to connect to."""

    def listen(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Refuse to listen."""
        raise _stays()

    def join(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Refuse to join."""
        raise _stays()


def _stays() -> TransportError:
    return TransportError("`memory` stays within one process: choose another transport, such as `tcp`, to join others")
