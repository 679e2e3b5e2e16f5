"""A log is verified with its own scenario: later changes are detected and located."""

import json
import os
import random
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from altered_logs import altered
from checkout import CHECKOUT

from symaware_cli import open_log
from symaware_cli.evidence.verification import VerificationResult, verify_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log import wire
from symaware_cli.log.error import LogError
from symaware_cli.log.log_message import LogMessage

SCENARIOS = sorted(
    path
    for path in (CHECKOUT / "scenarios").rglob("*")
    if path.suffix in (".yaml", ".toml") and not path.name.startswith("_")
)

#: The number of random changes to try.
CHANGES = int(os.environ.get("SYMAWARE_CHANGES", "15"))


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda path: path.name)
def test_every_shipped_scenario_is_reproducible(scenario: Path, tmp_path: Path) -> None:
    execute(build(scenario, ["run.duration=2"]), tmp_path / "run.mcap")
    result = verify_log(tmp_path / "run.mcap")
    assert result.is_equal
    assert result.is_whole
    assert result.messages > 0


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "patrol.mcap"
    scenario = next(each for each in SCENARIOS if each.name == "patrol.yaml")
    execute(build(scenario, ["run.duration=3"]), path)
    return path


def test_an_unchanged_log_is_verified(log: Path) -> None:
    result = verify_log(log)
    assert result.is_equal
    assert result.until == 3.0
    assert not result.versions


def test_a_changed_value_is_reported_with_its_agent_element_and_writer(log: Path, tmp_path: Path) -> None:
    group = next(iter(open_log(log).agents))

    def changed(message: LogMessage) -> bytes:
        if message.channel.topic == f"/agents/{group}/control" and message.time == 1_000_000_000:
            content = message.decode()
            values = np.array(content.values)
            values[0, 1] += 1e-9
            return wire.encode_rows(values, content.rows)
        return message.data

    altered(log, tmp_path / "forged.mcap", changed)
    result = verify_log(tmp_path / "forged.mcap")
    difference = result.difference
    assert difference is not None
    assert (difference.time, difference.topic) == (1_000_000_000, f"/agents/{group}/control")
    assert difference.agent == open_log(log).agents[group][0]
    assert difference.distance == pytest.approx(1e-9, rel=1e-3)
    assert result.writer.startswith(f"agents.{group}.")


def test_a_nondeterministic_component_is_named(doubles: Path, tmp_path: Path) -> None:
    scenario = tmp_path / "dice.yaml"
    scenario.write_text(
        "symaware: 1\nname: dice\nseed: 1\nrun: {duration: 1.0}\n"
        "environment: {use: kinematic, with: {time_step: 0.1}}\n"
        "agents:\n  robot:\n    count: 2\n    model: {use: single-integrator}\n    state: [[0, 0], [3, 0]]\n"
        "    components:\n      see: {use: perception.self}\n"
        "      dice: {use: doubles.chance, with: {source: random, row: 1}}\n"
    )
    execute(build(scenario), tmp_path / "dice.mcap")
    result = verify_log(tmp_path / "dice.mcap")
    found = result.difference
    assert found is not None
    assert (found.time, found.topic, found.agent, found.element) == (
        300_000_000,
        "/agents/robot/risk",
        "robot.1",
        "risk[0]",
    )
    assert result.writer == "agents.robot.dice"


def test_every_random_change_of_the_data_is_detected(log: Path, tmp_path: Path) -> None:
    chance = random.Random(5)
    count = sum(message.channel.topic != "/timing" for message in open_log(log).messages())
    missed = []
    for _ in range(CHANGES):
        change = _Change(chance.randrange(count), chance.random() < 0.8, chance.random(), chance.randrange(8))
        altered(log, tmp_path / "forged.mcap", change)
        if _verified(tmp_path / "forged.mcap") is True:
            missed.append(change)
    assert not missed


@dataclass
class _Change:
    """Flips a bit of the message with a number, or removes the message."""

    target: int
    is_kept: bool
    place: float
    bit: int
    seen: int = -1

    def __call__(self, message: LogMessage) -> bytes | None:
        self.seen += message.channel.topic != "/timing"
        if message.channel.topic == "/timing" or self.seen != self.target:
            return message.data
        if not self.is_kept or not message.data:
            return None
        data = bytearray(message.data)
        data[int(self.place * len(data))] ^= 1 << self.bit
        return bytes(data)


def _verified(path: Path) -> bool | str:
    """Return whether a log is verified, or the error if it cannot be read."""
    try:
        return verify_log(path).is_equal
    except LogError as error:
        return str(error)


def test_a_changed_attachment_is_detected(log: Path, tmp_path: Path) -> None:
    def other_name(name: str, data: bytes) -> bytes:
        if name != "manifest.json":
            return data
        return json.dumps({**json.loads(data), "name": "another"}, indent=1).encode()

    altered(log, tmp_path / "forged.mcap", attachment=other_name)
    result = verify_log(tmp_path / "forged.mcap")
    assert [each.topic for each in result.attachments] == ["manifest.json"]
    assert not result.is_equal


def test_a_changed_seed_in_the_scenario_is_detected(log: Path, tmp_path: Path) -> None:
    def other_seed(name: str, data: bytes) -> bytes:
        return data.replace(b"seed: ", b"seed: 9") if name == "resolved.yaml" else data

    altered(log, tmp_path / "forged.mcap", attachment=other_seed)
    assert not verify_log(tmp_path / "forged.mcap").is_equal


def test_differences_in_installed_versions_are_reported(log: Path, tmp_path: Path) -> None:
    def older(name: str, data: bytes) -> bytes:
        return json.dumps({**json.loads(data), "numpy": "1.0"}).encode() if name == "versions.json" else data

    altered(log, tmp_path / "old.mcap", attachment=older)
    result: VerificationResult = verify_log(tmp_path / "old.mcap")
    assert result.is_equal
    assert [(each.name, each.then) for each in result.versions] == [("numpy", "1.0")]


def test_a_truncated_log_is_compared_up_to_its_end(log: Path, tmp_path: Path) -> None:
    content = log.read_bytes()
    whole = tmp_path / "long.mcap"
    scenario = next(each for each in SCENARIOS if each.name == "patrol.yaml")
    execute(build(scenario, ["run.duration=40"]), whole)
    content = whole.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: len(content) * 2 // 3])
    result = verify_log(tmp_path / "cut.mcap")
    assert result.is_equal
    assert not result.is_whole
    assert 0 < result.until < 40
