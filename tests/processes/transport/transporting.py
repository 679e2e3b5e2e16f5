"""What tests of transports share: ports that are closed in the end, processes, and a look at what this one holds."""

import subprocess
import sys
import time
from collections.abc import Callable

from symaware_cli.processes.transport import Port, PortEvent, Transport

KEY = b"a key that both ends know"

#: A member in a process of its own, which sends back what it is told.
ECHO = """
import sys
from importlib import import_module
module, kind, port, key, timeout = sys.argv[1:]
transport = getattr(import_module(module), kind)
transport = transport(transport.Parameters(timeout=float(timeout)))
port = transport.join("127.0.0.1", int(port), bytes.fromhex(key) or None)
print("started", flush=True)
while True:
    happening = port.receive()
    if happening.kind == "frame":
        port.send(happening.peer, happening.frame)
"""

#: One that tells how many frames it took when its host is gone, and why that is.
COUNT = (
    ECHO.partition("while")[0]
    + """
count = 0
while (happening := port.receive()).kind != "gone":
    count += happening.kind == "frame"
print(count, happening.reason)
"""
)


def echo(transport: Transport, port: Port, key: bytes | None = None, script: str = ECHO) -> subprocess.Popen[str]:
    """Start a process that joins and sends back what it is told."""
    kind = type(transport)
    settings = [kind.__module__, kind.__name__, number(port), (key or b"").hex(), transport.parameters.timeout]
    line = [sys.executable, "-c", script, *map(str, settings)]
    return subprocess.Popen(line, stdout=subprocess.PIPE, text=True)


def number(port: Port) -> int:
    """The number of a port."""
    return int(port.address.rpartition(":")[2])


def expect(port: Port, kind: str, within: float = 60.0) -> PortEvent:
    """What happens next at a port, which must be of a kind."""
    happening = port.receive(within)
    assert happening is not None, f"nothing happened, where {kind} should"
    assert happening.kind == kind, happening
    return happening


def eventually(condition: Callable[[], bool], within: float = 60.0) -> bool:
    """Whether something comes true, if one waits for it."""
    deadline = time.monotonic() + within
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True
