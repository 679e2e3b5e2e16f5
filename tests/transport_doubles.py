"""A transport that an installed package might bring."""

from pathlib import Path

from symaware_cli.processes.tcp import Tcp
from symaware_cli.processes.transport import Port


class Loud(Tcp):
    """A transport of another package, which reports its address."""

    def listen(self, host: str, port: int, key: bytes | None = None) -> Port:
        Path("loud.txt").write_text(f"{host}:{port}")
        return super().listen(host, port, key)
