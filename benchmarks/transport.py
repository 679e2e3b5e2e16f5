"""Benchmark of frames between two processes on loopback, compared with plain asyncio streams: ``python transport.py``.

The transports are measured in turn, several times, under the same conditions; the median counts. A round trip is a
frame to the other process and back. For throughput, many frames are sent one after another, and acknowledged at the
end.
"""

import argparse
import asyncio
import importlib.util
import json
import statistics
import subprocess
import sys
import time

from symaware_cli.processes import Port, Transport
from symaware_cli.processes.tcp import Tcp
from symaware_cli.processes.zenoh import Zenoh

KEY = b"thirty-two bytes of a shared key"

#: For each frame size [bytes]: number of round trips, number of frames for throughput, and frames per burst.
LOADS = {1000: (2000, 20_000, 500), 10**6: (100, 300, 10)}

#: Instructions to the other process, as the first byte of a frame: return it, ignore it, or acknowledge.
BACK, COUNT, TELL = b"b", b"c", b"t"

WAYS: dict[str, tuple[type[Transport] | None, bytes | None]] = {
    "asyncio streams": (None, None),
    "tcp": (Tcp, None),
    "tcp, sealed": (Tcp, KEY),
    "zenoh": (Zenoh, None),
    "zenoh, sealed": (Zenoh, KEY),
}


def main() -> None:
    """Print the figures as JSON, or run the other process."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--other", nargs=2, metavar=("WAY", "PORT"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.other:
        _serve(arguments.other[0], int(arguments.other[1]))
        return
    ways = [way for way in WAYS if not way.startswith("zenoh") or importlib.util.find_spec("zenoh")]
    measured: dict[tuple[str, str], list[float]] = {}
    for _ in range(arguments.rounds):
        for way in ways:
            for name, figure in _measure(way).items():
                measured.setdefault((name, way), []).append(figure)
    figures: dict[str, dict[str, float]] = {}
    for (name, way), samples in measured.items():
        figures.setdefault(name, {})[way] = round(statistics.median(samples), 1)
        plain = measured[name, "asyncio streams"]
        if way != "asyncio streams":
            ratio = statistics.median(each / other for each, other in zip(samples, plain, strict=True))
            figures[name][f"{way}, ratio"] = round(ratio, 2)
    print(json.dumps(figures, indent=2))


def _measure(way: str) -> dict[str, float]:
    kind, key = WAYS[way]
    if kind is None:
        return asyncio.run(_streams(way))
    with kind().listen("127.0.0.1", 0, key) as port:
        other = _start(way, int(port.address.rpartition(":")[2]))
        try:
            return _over_port(port)
        finally:
            other.kill()
            other.wait()


def _over_port(port: Port) -> dict[str, float]:
    came = port.receive(30)
    assert came is not None
    assert came.kind == "came"

    def receive() -> None:
        event = port.receive(30)
        assert event is not None
        assert event.kind == "frame"

    figures = {}
    for size, (trips, count, burst) in LOADS.items():
        frame = BACK + bytes(size - 1)
        started = time.perf_counter()
        for _ in range(trips):
            port.send(came.peer, frame)
            receive()
        figures[_trips(size)] = trips / (time.perf_counter() - started)
        frame = COUNT + bytes(size - 1)
        started = time.perf_counter()
        for _ in range(count // burst):
            for _ in range(burst):
                port.send(came.peer, frame)
            port.send(came.peer, TELL)
            receive()
        figures[_flow(size)] = size * count / (time.perf_counter() - started) / 1e6
    return figures


async def _streams(way: str) -> dict[str, float]:
    connected: asyncio.Queue[tuple[asyncio.StreamReader, asyncio.StreamWriter]] = asyncio.Queue()

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await connected.put((reader, writer))

    server = await asyncio.start_server(accept, "127.0.0.1", 0)
    other = _start(way, server.sockets[0].getsockname()[1])
    reader, writer = await connected.get()
    figures = {}
    for size, (trips, count, burst) in LOADS.items():
        frame = BACK + bytes(size - 1)
        started = time.perf_counter()
        for _ in range(trips):
            await _write(writer, frame)
            await _read(reader)
        figures[_trips(size)] = trips / (time.perf_counter() - started)
        frame = COUNT + bytes(size - 1)
        started = time.perf_counter()
        for _ in range(count // burst):
            for _ in range(burst):
                await _write(writer, frame)
            await _write(writer, TELL)
            await _read(reader)
        figures[_flow(size)] = size * count / (time.perf_counter() - started) / 1e6
    writer.close()
    server.close()
    other.kill()
    other.wait()
    return figures


def _trips(size: int) -> str:
    return f"round trips of {size} bytes per second"


def _flow(size: int) -> str:
    return f"MB/s in frames of {size} bytes"


def _start(way: str, number: int) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, __file__, "--other", way, str(number)])


def _serve(way: str, number: int) -> None:
    kind, key = WAYS[way]
    if kind is None:
        asyncio.run(_serve_streams(number))
        return
    with kind().join("127.0.0.1", number, key) as port:
        while (event := port.receive()) is not None and event.kind != "gone":
            if event.kind == "frame" and event.frame[:1] != COUNT:
                port.send(event.peer, event.frame)


async def _serve_streams(number: int) -> None:
    reader, writer = await asyncio.open_connection("127.0.0.1", number)
    while True:
        frame = await _read(reader)
        if frame[:1] != COUNT:
            await _write(writer, frame)


async def _write(writer: asyncio.StreamWriter, frame: bytes) -> None:
    writer.write(len(frame).to_bytes(4))
    writer.write(frame)
    await writer.drain()


async def _read(reader: asyncio.StreamReader) -> bytes:
    return await reader.readexactly(int.from_bytes(await reader.readexactly(4)))


if __name__ == "__main__":
    main()
