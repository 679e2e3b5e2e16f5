"""A member that rejoins continues from the state that it stored."""

import copy
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from simulating import present
from spreading import TALK, Process, Spread, alone, await_file, busy, differences, events, successor

import symaware_cli as sa
from symaware_cli import __version__, open_log
from symaware_cli.engine.runtime.state.simulation_state import SimulationState
from symaware_cli.language.build import build
from symaware_cli.processes import sent_frames
from symaware_cli.processes.checkpoint_file import CheckpointFile
from symaware_cli.processes.frame import Checkpoint
from symaware_cli.processes.participant import Identity
from symaware_cli.processes.sent_frames import SentFrames


def lasting(mode: str = "synchronous") -> dict[str, Any]:
    """`TALK`, in which the run waits for lost processes, and in which each step takes some wall time."""
    document = copy.deepcopy(TALK)
    if mode == "asynchronous":
        document = busy(document)
    document["run"]["mode"] = mode
    for group in document["agents"].values():
        for component in group["components"].values():
            component |= {"on_failure": "restart", "tries": 9}
    document["agents"]["clock"] = {
        "model": {"use": "single-integrator"},
        "state": [90.0, 90.0],
        "components": {"tick": {"use": "doubles.sleeper", "period": 0.05, "with": {"duration": 0.03}}},
    }
    return document


def started(run: Spread) -> tuple[Process, Process, Process]:
    """Start a host and two members."""
    host = run.host("--only", "clock,car.1,walker.[02]")
    west = run.member("west", "car.0,robot.[02],walker.1")
    east = run.member("east", "car.2,robot.1,robot.3")
    for each in (host, west, east):
        each.wait_for("east takes part")
    return host, west, east


def state_of(run: Spread, name: str) -> Path:
    return run.folder / f"talk.{name}.state"


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_a_member_that_was_killed_continues_and_the_run_is_that_of_one_process(
    spread: Callable[..., Spread], doubles: Path, tmp_path: Path, mode: str
) -> None:
    run = spread(lasting(mode))
    host, west, _ = started(run)
    await_file(state_of(run, "west"))
    time.sleep(0.6)
    west.send(signal.SIGKILL)
    host.wait_for("waits 60 s for it")
    back = run.member("west", "car.0,robot.[02],walker.1")
    back.wait_for("continues from its state")
    assert run.end() == [0, -signal.SIGKILL, 0, 0]
    whole, merged = alone(tmp_path, run.scenario), run.merged()
    assert differences(whole, merged) == {}
    assert whole.outcome == merged.outcome
    assert [len(events(merged, name)) for name in ("lost", "rejoined", "restored")] == [1, 1, 1]
    assert not state_of(run, "west").exists()
    assert not open_log(back.log).damage


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_members_may_die_one_after_the_other_and_while_they_repeat_steps(
    spread: Callable[..., Spread], doubles: Path, tmp_path: Path, mode: str
) -> None:
    run = spread(lasting(mode))
    host = run.host("--only", "clock,car.1,walker.0")
    agents = {"west": "car.0,robot.[02],walker.1", "east": "car.2,robot.1,robot.3"}
    present_one = {name: run.member(name, each) for name, each in agents.items()}
    for name in agents:
        host.wait_for(f"{name} is there")
    substitutes = [run.member(name, agents[name]) for name in ("west", "west", "west", "east")]
    for each in substitutes:
        each.wait_for(f"run in {each.name}")
    run.member("south", "walker.2")
    host.wait_for("south takes part")
    died = []
    for name, after in (("west", 0.5), ("west", 0.0), ("east", 0.4), ("west", 0.4)):
        await_file(state_of(run, name))
        time.sleep(after)
        present_one[name].send(signal.SIGKILL)
        died.append(present_one[name])
        present_one[name] = successor(substitutes, name)
        substitutes.remove(present_one[name])
    for each, status in zip(run.processes, run.end(), strict=True):
        assert status == (-signal.SIGKILL if each in died else 0), each.text
    whole, merged = alone(tmp_path, run.scenario), run.merged()
    assert differences(whole, merged) == {}
    assert whole.outcome == merged.outcome


DAMAGES: dict[str, tuple[Callable[[bytes], bytes | None], str]] = {
    "cut": (lambda data: data[:-100], "it is damaged: its checksum is wrong"),
    "flipped": (lambda data: data[:500] + bytes([data[500] ^ 8]) + data[501:], "it is damaged: its checksum is wrong"),
    "empty": (lambda data: b"", "it is not the state of a member"),
    "missing": (lambda data: None, "there is no stored state"),
    "earlier": (lambda data: EARLIER[0], "is of another run, or the host no longer has what it sent since then"),
}
"""What happens to a stored state, and what is said about it."""

EARLIER: list[bytes] = []
"""The first state that a member has stored."""


@pytest.mark.slow
def test_a_member_whose_stored_state_cannot_be_used_says_so_and_begins_anew(
    spread: Callable[..., Spread], doubles: Path, scenarios: Path
) -> None:
    document = lasting()
    document["run"]["duration"] = 1000.0
    run = spread(document)
    host, west, _ = started(run)
    path = state_of(run, "west")
    for count, (damage, said) in enumerate(DAMAGES.values(), 1):
        await_file(path)
        time.sleep(0.3)
        west.send(signal.SIGKILL)
        host.wait_for("waits 60 s for it", count)
        EARLIER.append(path.read_bytes())
        content = damage(path.read_bytes())
        path.unlink()
        if content is not None:
            path.write_bytes(content)
        west = run.member("west", "car.0,robot.[02],walker.1")
        assert said in west.wait_for("the agents of west begin anew")
        west.wait_for("west is back")
        path.unlink(missing_ok=True)
    await_file(path)
    west.send(signal.SIGKILL)
    host.wait_for("waits 60 s for it", len(DAMAGES) + 1)
    forge(path, run.scenario)
    forged = run.member("west", "car.0,robot.[02],walker.1")
    assert "cannot be restored, and is removed: " in forged.wait_for("start the process again")
    assert forged.end() == 1
    west = run.member("west", "car.0,robot.[02],walker.1")
    assert "there is no stored state" in west.wait_for("the agents of west begin anew")
    host.send(signal.SIGINT)
    assert run.end()[0] == 130
    merged = run.merged()
    assert [len(events(merged, name)) for name in ("lost", "rejoined")] == [len(DAMAGES) + 2] * 2
    # What a process has recorded is in its log after half a second; some die before.
    assert events(merged, "not-restored")


def forge(path: Path, scenario: Path) -> None:
    """Replace a stored state by one that claims to be of the same run, but that nobody has captured."""
    agents = ("car.0", "robot.0", "robot.2", "walker.1")
    file = CheckpointFile(path.parent, "talk", Identity("west", build(scenario).digest, __version__, agents))
    checkpoint, state = present(file.read())
    entries = [(kind, "nowhere.Nothing" if kind == "object" else name, parts) for kind, name, parts in state.entries]
    file.write(checkpoint.run, replace(state, entries=entries))


@pytest.mark.slow
def test_a_member_whose_coroutines_always_wait_says_so_and_its_agents_begin_anew(
    spread: Callable[..., Spread], doubles: Path
) -> None:
    document = lasting("asynchronous")
    nap = {"use": "doubles.napper", "period": 0.0, "on_failure": "restart", "tries": 9}
    document["agents"]["walker"]["components"]["nap"] = nap
    run = spread(document)
    host, west, _ = started(run)
    assert "agents.walker.1.nap" in west.wait_for("the state of west is not stored")
    west.send(signal.SIGKILL)
    host.wait_for("waits 60 s for it")
    back = run.member("west", "car.0,robot.[02],walker.1")
    assert "there is no stored state" in back.wait_for("the agents of west begin anew")
    assert run.end() == [0, -signal.SIGKILL, 0, 0]
    assert events(open_log(back.log), "not-restored")


IDENTITY = Identity("west", b"scenario", "1.0", ("robot.0", "robot.1"))


@pytest.fixture(scope="module")
def state(scenarios: Path) -> SimulationState:
    """The state of a simulation after some steps."""
    with sa.load(scenarios / "hello.yaml").start() as simulation:
        simulation.step(3)
        return simulation.capture()


def test_a_stored_state_is_read_again(tmp_path: Path, state: SimulationState) -> None:
    file = CheckpointFile(tmp_path, "hello", IDENTITY)
    assert file.read() is None
    file.write(b"run", state)
    checkpoint, found = present(file.read())
    assert checkpoint == Checkpoint(b"run", 3)
    assert found.to_bytes() == state.to_bytes()
    assert [each.name for each in tmp_path.iterdir()] == ["hello.west.state"]
    file.remove()
    file.remove()
    assert file.read() is None


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"scenario": b"other"}, "it is of another scenario, or other overrides or another seed"),
        ({"version": "2.0"}, "it is of SymAware 1.0"),
        ({"agents": ("robot.0",)}, "it is of other agents"),
    ],
)
def test_the_state_of_another_member_is_refused_by_name(
    tmp_path: Path, state: SimulationState, changes: dict[str, Any], said: str
) -> None:
    CheckpointFile(tmp_path, "hello", IDENTITY).write(b"run", state)
    other = CheckpointFile(tmp_path, "hello", replace(IDENTITY, **changes))
    with pytest.raises(sa.StateError, match=f"hello.west.state cannot be used: {said}"):
        other.read()


def test_no_damage_of_a_stored_state_goes_unnoticed(tmp_path: Path, state: SimulationState) -> None:
    file = CheckpointFile(tmp_path, "hello", IDENTITY)
    file.write(b"run", state)
    data = file.path.read_bytes()
    for place in range(0, len(data), max(1, len(data) // 100)):
        damaged = bytearray(data)
        damaged[place] ^= 1
        for content in (bytes(damaged), data[:place], data + data[: place + 1]):
            file.path.write_bytes(content)
            with pytest.raises(sa.StateError, match=r"hello\.west\.state cannot be used: "):
                file.read()


def test_a_folder_in_the_place_of_a_stored_state_is_refused(tmp_path: Path, state: SimulationState) -> None:
    file = CheckpointFile(tmp_path, "hello", IDENTITY)
    file.path.mkdir()
    with pytest.raises(sa.StateError, match=r"hello\.west\.state cannot be used: it is not a file"):
        file.read()
    with pytest.raises(sa.LogError, match=r"hello\.west\.state"):
        file.write(b"run", state)


def test_names_of_members_are_names_of_files(tmp_path: Path, state: SimulationState) -> None:
    file = CheckpointFile(tmp_path, "hello", replace(IDENTITY, name="../a/b robot.[0-5]"))
    file.write(b"run", state)
    assert file.path.parent == tmp_path
    assert file.read() is not None


def test_the_host_keeps_what_it_sent_since_the_last_checkpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sent_frames, "_RECENT", 1)
    sent = SentFrames()
    sent.add(b"joined")
    assert sent.after(0) is None
    sent.add(b"step 0", 0)
    sent.add(b"notice")
    assert sent.after(0) == [(None, b"notice")]
    sent.add(b"step 1", 1)
    # Nothing was reported: the member may only have stored its state after one of the latest steps in the meantime.
    assert sent.after(0) == [(None, b"notice"), (1, b"step 1")]
    sent.add(b"step 2", 2)
    assert sent.after(0) is None
    assert sent.after(1) == [(2, b"step 2")]
    sent.keep_since(1)
    sent.add(b"notice")
    for step in (3, 4):
        sent.add(b"step", step)
        sent.add(b"notice")
    assert [number for number, _ in present(sent.after(1))] == [2, None, 3, None, 4, None]
    assert [number for number, _ in present(sent.after(3))] == [None, 4, None]
    sent.keep_since(3)
    assert sent.after(2) is None
    sent.keep_since(2)
    sent.keep_since(9)
    assert [number for number, _ in present(sent.after(3))] == [None, 4, None]
    assert sent.after(5) is None


def test_the_memory_of_the_host_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sent_frames, "_MOST", 100)
    sent = SentFrames()
    sent.add(b"step", 0)
    sent.keep_since(0)
    for step in range(1, 10):
        sent.add(bytes(10), step)
    assert len(present(sent.after(0))) == 9
    for step in range(10, 20):
        sent.add(bytes(10), step)
    assert sent.after(0) is None
    # Until the member reports a further one.
    sent.keep_since(19)
    sent.add(bytes(10), 20)
    assert sent.after(19) == [(20, bytes(10))]
