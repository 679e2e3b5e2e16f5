"""The state of a simulation, taken and put back."""

import hashlib
import os
import subprocess
import sys
import zlib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from checkout import CHECKOUT

import symaware_cli as sa

SCENARIOS = CHECKOUT / "scenarios"

#: Shipped scenarios of a world without a physics engine, and a step at which to take their state.
KINEMATIC = {
    "patrol": 30,
    "shortcut": 30,
    "hello": 12,
    "asynchronous": 11,
    "consensus": 9,
    "flooding": 20,
    "formation": 1,
    "noisy": 15,
    "mpc": 4,
    "traffic": 58,
}


def messages(path: Path, since: int = 0) -> list[tuple[int, int, str, bytes]]:
    """All messages of a log from a sequence number on, but those of wall time."""
    return [
        (each.sequence, each.time, each.channel.topic, each.data)
        for each in sa.open_log(path).messages()
        if each.channel.topic != "/timing" and each.sequence >= since
    ]


@pytest.mark.parametrize("name", KINEMATIC)
def test_a_simulation_goes_on_from_its_state_as_if_nothing_had_come_between(name: str, tmp_path: Path) -> None:
    scenario, step = sa.load(SCENARIOS / f"{name}.yaml"), KINEMATIC[name]
    with scenario.start(output=tmp_path / "whole.mcap") as simulation:
        simulation.step(step + 8)
        whole = simulation.state(next(iter(simulation.groups)))
    with scenario.start(output=tmp_path / "again.mcap") as simulation:
        simulation.step(step)
        state = simulation.capture()
        simulation.step(5)
        simulation.restore(state)
        simulation.step(8)
        assert np.array_equal(simulation.state(next(iter(simulation.groups))), whole)
    assert messages(tmp_path / "again.mcap") == messages(tmp_path / "whole.mcap")


@pytest.mark.parametrize("name", ["hello", *(pytest.param(each, marks=pytest.mark.slow) for each in KINEMATIC)])
@pytest.mark.parametrize("steps", [1, 4])
def test_restoring_the_state_at_the_start_is_a_reset_with_all_messages(name: str, steps: int, tmp_path: Path) -> None:
    scenario = sa.load(SCENARIOS / f"{name}.yaml")
    with scenario.start(output=tmp_path / "whole.mcap") as simulation:
        simulation.step(6)
    with scenario.start(output=tmp_path / "again.mcap") as simulation:
        state = simulation.capture()
        for _ in range(2):
            simulation.step(steps)
            simulation.restore(state)
        simulation.step(6)
    assert messages(tmp_path / "again.mcap") == messages(tmp_path / "whole.mcap")
    with scenario.start(output=tmp_path / "fresh.mcap") as simulation:
        simulation.restore(sa.SimulationState.from_bytes(state.to_bytes()))
        simulation.step(6)
    assert messages(tmp_path / "fresh.mcap") == messages(tmp_path / "whole.mcap")


def test_a_log_that_went_back_and_ended_holds_nothing_of_what_it_discarded(tmp_path: Path) -> None:
    with sa.load(SCENARIOS / "hello.yaml").start(output=tmp_path / "hello.mcap") as simulation:
        state = simulation.capture()
        simulation.step(40)
        simulation.capture()  # writes what the log holds in memory
        simulation.restore(state)
    content = (tmp_path / "hello.mcap").read_bytes()
    magic = content[:8]
    assert content.endswith(magic)
    assert content.count(magic) == 2


@pytest.mark.parametrize("name", ["billiards", "drones"])
def test_a_world_with_a_physics_engine_is_refused_by_name(name: str) -> None:
    with sa.load(SCENARIOS / f"{name}.yaml").start() as simulation:
        simulation.step(2)
        with pytest.raises(sa.StateError, match="the state of the environment cannot be captured: its engine"):
            simulation.capture()
        simulation.step()


def test_a_fresh_process_goes_on_from_bytes_with_the_same_sequence_numbers(tmp_path: Path) -> None:
    path = SCENARIOS / "flooding.yaml"
    scenario = sa.load(path)
    with scenario.start(output=tmp_path / "whole.mcap") as simulation:
        simulation.step(20)
        (tmp_path / "state").write_bytes(simulation.capture().to_bytes())
        simulation.step(10)
    code = (
        "import sys, symaware_cli as sa\n"
        "from pathlib import Path\n"
        "path, state, log = sys.argv[1:]\n"
        "with sa.load(path).start(output=log) as simulation:\n"
        "    simulation.restore(sa.SimulationState.from_bytes(Path(state).read_bytes()))\n"
        "    simulation.step(10)\n"
    )
    arguments = [path, tmp_path / "state", tmp_path / "rest.mcap"]
    subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)], check=True, env={**os.environ, "PYTHONHASHSEED": "7"}
    )
    rest = [each for each in messages(tmp_path / "rest.mcap") if each[1] >= 2_000_000_000]
    assert len(rest) > 50
    assert rest == messages(tmp_path / "whole.mcap", since=rest[0][0])


def test_a_state_can_be_put_back_as_often_as_one_likes(path: Path) -> None:
    with sa.load(path).start() as simulation:
        simulation.step(3)
        state, ends = simulation.capture(), []
        for _ in range(3):
            simulation.restore(state)
            assert simulation.steps == 3
            simulation.step(10)
            ends.append(simulation.state("robot"))
    assert np.array_equal(ends[0], ends[1])
    assert np.array_equal(ends[0], ends[2])


def test_controls_from_outside_are_part_of_the_state(path: Path) -> None:
    with sa.load(path).start() as simulation:
        simulation.step(2)
        simulation.set_control("robot.0", np.full(len(simulation.control_columns("robot")), 0.25))
        state = simulation.capture()
        simulation.step(5)
        wanted = simulation.state("robot")
        simulation.set_control("robot.0", None)
        simulation.restore(state)
        simulation.step(5)
        assert np.array_equal(simulation.state("robot"), wanted)


def test_what_was_handed_out_before_does_not_change_as_a_state_is_put_back(path: Path) -> None:
    with sa.load(path).start() as simulation:
        simulation.step(2)
        state = simulation.capture()
        simulation.step(4)
        held = simulation.state("robot")
        before = held.copy()
        simulation.restore(state)
        assert np.array_equal(held, before)


def test_the_state_of_another_seed_is_refused(path: Path) -> None:
    with sa.load(path).start(seed=1) as one, sa.load(path).start(seed=2) as other:
        one.step(2)
        before = other.state("robot")
        with pytest.raises(sa.StateError, match="to another seed"):
            other.restore(one.capture())
        assert other.steps == 0
        assert np.array_equal(other.state("robot"), before)


def test_bytes_that_are_no_state_are_refused(path: Path) -> None:
    with sa.load(path).start() as simulation:
        data = simulation.capture().to_bytes()
    with pytest.raises(sa.StateError, match="not the state"):
        sa.SimulationState.from_bytes(b"something else")
    with pytest.raises(sa.StateError, match="damaged"):
        sa.SimulationState.from_bytes(data[:-20])


@pytest.mark.parametrize("seed", range(60))
def test_bytes_that_were_changed_are_refused_with_one_kind_of_error(seed: int, changed: bytes) -> None:
    chance = np.random.default_rng(seed)
    data = bytearray(changed)
    match seed % 3:
        case 0:
            data[int(chance.integers(len(data)))] ^= 1 << int(chance.integers(8))
        case 1:
            place = int(chance.integers(len(data)))
            data[place:place] = chance.bytes(3)
        case 2:
            del data[int(chance.integers(len(data))) :]
    with pytest.raises(sa.StateError):
        sa.SimulationState.from_bytes(bytes(data))


@pytest.fixture(scope="module")
def changed() -> bytes:
    """The bytes of a state that are to be changed."""
    with sa.load(SCENARIOS / "hello.yaml").start() as simulation:
        return simulation.capture().to_bytes()


@pytest.mark.parametrize("seed", [*range(6), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(6, 60))])
def test_a_forged_state_is_refused_or_restored_and_restoring_raises_nothing_else(seed: int) -> None:
    chance, scenario = np.random.default_rng(seed), sa.load(SCENARIOS / "hello.yaml", {"run.duration": 1.0})
    raised: list[Exception | None] = []
    # What a forged state contains may end a run in any way, once it was restored.
    with suppress(Exception), scenario.start() as simulation:
        state = simulation.capture()
        entries = [(kind, name, [*contents]) for kind, name, contents in state.entries]
        for _ in range(3):
            kind, name, contents = entries[number := int(chance.integers(len(entries)))]
            match int(chance.integers(4)):
                case 0:
                    kind = str(chance.choice(["object", "list", "array", "view", "method", "function", "odd"]))
                case 1:
                    name = str(chance.choice(["", "os:system", "builtins:eval", "numpy:ndarray", "x"]))
                case 2 if contents:
                    contents[int(chance.integers(len(contents)))] = (int(chance.integers(len(entries))),)
                case _:
                    del contents[int(chance.integers(len(contents) + 1)) :]
            entries[number] = kind, name, contents
        forged = replace(state, entries=entries)
        try:
            simulation.restore(sa.SimulationState.from_bytes(forged.to_bytes()))
            raised.append(None)
        except sa.StateError:
            raised.append(None)
        except Exception as error:
            raised.append(error)
    assert raised == [None]


def test_bytes_that_would_expand_without_limit_are_refused() -> None:
    with sa.load(SCENARIOS / "hello.yaml").start() as simulation:
        magic = simulation.capture().to_bytes()[: len(b"SymAware state 2\n")]
    packing = zlib.compressobj(9)
    packed = b"".join(packing.compress(bytes(2**24)) for _ in range(20)) + packing.flush()
    assert len(packed) < 2**20
    with pytest.raises(sa.StateError, match="larger than 268,435,456 bytes"):
        sa.SimulationState.from_bytes(magic + hashlib.sha256(packed).digest() + packed)


@pytest.mark.parametrize("name", ["hello", "patrol"])
def test_a_state_captured_with_a_log_can_be_restored_without_one(name: str, tmp_path: Path) -> None:
    scenario = sa.load(SCENARIOS / f"{name}.yaml", {"run.duration": 1.0})
    with scenario.start(output=tmp_path / "run.mcap") as simulation:
        simulation.step(3)
        state = simulation.capture()
        simulation.step(5)
        ends = {group: simulation.state(group) for group in simulation.groups}
    with scenario.start() as simulation:
        simulation.restore(state)
        simulation.step(5)
        assert all(np.array_equal(simulation.state(group), end) for group, end in ends.items())


def test_a_run_that_is_over_has_no_state_to_take(path: Path) -> None:
    with sa.load(path).start() as simulation:
        simulation.finish()
        with pytest.raises(sa.StateError, match="is over: finished"):
            simulation.capture()


def test_a_log_does_not_go_back_behind_what_another_one_knows(path: Path, tmp_path: Path) -> None:
    with sa.load(path).start(output=tmp_path / "one.mcap") as one:
        one.step(2)
        state = one.capture()
    with sa.load(path).start(output=tmp_path / "other.mcap") as other:
        other.step(5)
        with pytest.raises(sa.StateError, match=r"cannot go back to .* s: the state was not taken"):
            other.restore(state)
        other.step()
    with sa.load(path).start() as silent:
        silent.step(2)
        with_none = silent.capture()
    with (
        sa.load(path).start(output=tmp_path / "third.mcap") as third,
        pytest.raises(sa.StateError, match="without the log"),
    ):
        third.restore(with_none)
