"""A paced run keeps to the clock on the wall, and what it simulates is that of any other."""

import asyncio
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from simulating import Team, execute, present, simulation

from symaware_cli import Component, open_log
from symaware_cli.api.scenario import Mode
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.pacer import Pacer
from symaware_cli.engine.runtime.timing import Timing
from symaware_cli.log.digest import digest

MILLISECOND = 1_000_000


class Notes(Component):
    wall: list[float]
    now_too: list[int]

    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        self.wall.append(time.monotonic())
        self.now_too.append(self.now)


def notes() -> type[Notes]:
    return type("Notes", (Notes,), {"wall": [], "now_too": []})


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
@pytest.mark.parametrize("pace", [1.0, 4.0])
def test_no_turn_comes_before_its_time(mode: Mode, pace: float) -> None:
    kind = notes()
    ready = simulation({"a": Team({"it": kind}, timings={"it": Timing(period=50 * MILLISECOND)})})
    summary = execute(ready, 6, options=RunOptions(mode=mode, pace=pace))
    assert present(summary.pace).factor == pace
    assert present(summary.pace).instants == 6
    elapsed = [wall - kind.wall[0] for wall in kind.wall]
    due = [now / 1e9 / pace for now in kind.now_too]
    # The first turn itself may begin a little late, but the others not before they are due.
    assert all(wall >= when - 0.05 for wall, when in zip(elapsed, due, strict=True))
    assert summary.wall_time >= 0.3 / pace


def test_late_steps_are_counted() -> None:
    class Slow(Component):
        def _compute(self) -> None:
            time.sleep(0.03)

        def _update(self, value: Any) -> None:
            pass

    summary = execute(simulation({"a": Team({"it": Slow})}), 6, options=RunOptions(pace=2.0))
    assert present(summary.pace).late >= 5
    assert present(summary.pace).worst > 0.02
    assert summary.status == "finished"


def test_the_pace_stands_on_timing_and_nothing_else_of_the_log_changes(tmp_path: Path) -> None:
    logs = []
    for name, pace in (("free", None), ("paced", 20.0)):
        ready = simulation({"a": Team({"it": notes()}, count=2, timings={"it": Timing(period=20 * MILLISECOND)})})
        execute(ready, 6, tmp_path / f"{name}.mcap", RunOptions(mode="asynchronous", pace=pace))
        logs.append(open_log(tmp_path / f"{name}.mcap"))
    free, paced = logs
    assert digest(free).combined == digest(paced).combined
    last = [message.decode() for message in paced.messages(["/timing"])][-1]
    assert last.pace == 20.0
    # The turns at 20 ms and so on to 280 ms, the steps of the world at 50, 150, 250 and 300 ms.
    assert last.instants == 14 + 4
    assert [message.decode().pace for message in free.messages(["/timing"])][-1] == 0.0


def test_the_first_instant_starts_the_clock_and_later_ones_wait() -> None:
    pacer = Pacer(10.0)
    assert pacer.lead(0) == pytest.approx(0.0, abs=0.05)
    assert pacer.lead(10**9) == pytest.approx(0.1, abs=0.05)
    pacer.wait(10**9)
    assert pacer.lead(10**9) <= 0.0
    assert pacer.simulated() >= 10**9


class Listens(Component):
    """Waits for something outside."""

    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        self.emit("told", value, ms=self.now // MILLISECOND)


def test_a_paced_run_may_await_real_input_and_goes_on_meanwhile(tmp_path: Path) -> None:
    class Reads(Listens):
        async def _async_compute(self) -> Any:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            line = await reader.readline()
            writer.close()
            return line.decode().strip()

    port, stop = serve(b"hello\n", after=0.1)
    kind = notes()
    team = Team({"read": Reads, "it": kind}, timings={"read": Timing(period=10**10)})
    summary = execute(simulation({"a": team}), 12, tmp_path / "run.mcap", RunOptions(mode="asynchronous", pace=1.0))
    stop()
    assert summary.status == "finished", summary.failure
    (told,) = [event for event in open_log(tmp_path / "run.mcap").events() if event.name == "told"]
    assert told.text == "hello"
    assert 100 <= told.data["ms"] <= 600
    assert kind.now_too == [step * 50 * MILLISECOND for step in range(12)]


def test_an_outside_error_is_a_failure_of_the_component() -> None:
    class Reads(Listens):
        async def _async_compute(self) -> None:
            await asyncio.open_connection("127.0.0.1", 1)

    summary = execute(simulation({"a": Team({"read": Reads})}), 12, options=RunOptions(mode="asynchronous", pace=2.0))
    assert summary.status == "failed"
    assert "ConnectionRefusedError" in present(summary.failure)


def test_a_wait_without_end_does_not_keep_a_run_from_ending() -> None:
    class Waits(Listens):
        async def _async_compute(self) -> None:
            await asyncio.create_task(asyncio.sleep(3600))

    summary = execute(simulation({"a": Team({"wait": Waits})}), 4, options=RunOptions(mode="asynchronous", pace=2.0))
    assert summary.status == "finished"
    assert summary.wall_time < 30


def serve(content: bytes, after: float) -> tuple[int, Callable[[], None]]:
    """Send something to whoever connects, after a while; the port, and what ends it."""
    import socket

    listener = socket.create_server(("127.0.0.1", 0))

    def work() -> None:
        connection, _ = listener.accept()
        with connection:
            time.sleep(after)
            connection.sendall(content)

    thread = threading.Thread(target=work)
    thread.start()

    def stop() -> None:
        thread.join()
        listener.close()

    return listener.getsockname()[1], stop
