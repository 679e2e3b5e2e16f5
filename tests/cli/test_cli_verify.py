"""``symaware verify`` as a user sees it."""

import json
from pathlib import Path

import numpy as np
import pytest
from altered_logs import altered
from checkout import CHECKOUT
from mcap.opcode import Opcode
from typer.testing import CliRunner

from symaware_cli.cli.application import application
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log import wire
from symaware_cli.log.log_message import LogMessage

HELLO = CHECKOUT / "scenarios" / "hello.yaml"


def verify(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(application, ["verify", *map(str, arguments)], catch_exceptions=False)
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "hello.mcap"
    execute(build(HELLO, ["run.duration=1"]), path)
    return path


def test_an_equal_log_has_exit_status_0(log: Path) -> None:
    status, out, _ = verify(log)
    assert status == 0
    assert out.splitlines()[:2] == [f"{log}: equal", "  repeated     hello, seed 7, until 1 s"]


def test_a_difference_is_reported_with_its_place_and_exit_status_1(log: Path, tmp_path: Path) -> None:
    def changed(message: LogMessage) -> bytes:
        if message.channel.topic != "/world/robot/state" or message.time != 500_000_000:
            return message.data
        content = message.decode()
        values = np.array(content.values)
        values[2, 0] = 17.0
        return wire.encode_rows(values, content.rows)

    altered(log, tmp_path / "forged.mcap", changed)
    status, out, _ = verify(tmp_path / "forged.mcap")
    assert status == 1
    lines = out.splitlines()
    assert lines[0] == f"{tmp_path / 'forged.mcap'}: different from 0.5 s on"
    assert "  channel      /world/robot/state, written by environment" in lines
    assert "  agent        robot.2" in lines
    assert "  element      x" in lines
    assert "  in the log   17.0" in lines
    status, out, _ = verify(tmp_path / "forged.mcap", "--json")
    said = json.loads(out)
    assert (status, said["equal"], said["difference"]["agent"]) == (1, False, "robot.2")


def test_a_file_that_is_no_log_is_wrong_input(tmp_path: Path) -> None:
    (tmp_path / "no.mcap").write_bytes(b"nothing")
    status, _, err = verify(tmp_path / "no.mcap")
    assert status == 2
    assert err


def test_a_folder_without_a_sweep_is_wrong_input(tmp_path: Path) -> None:
    status, _, err = verify(tmp_path)
    assert status == 2
    assert "is not the folder of a sweep" in err


def test_missing_parts_of_a_damaged_log_are_reported(log: Path, tmp_path: Path) -> None:
    content = bytearray(log.read_bytes())
    start = 8
    while content[start] != Opcode.CHUNK:
        start += 9 + int.from_bytes(content[start + 1 : start + 9], "little")
    content[start + 8 + int.from_bytes(content[start + 1 : start + 9], "little") - 50] ^= 1
    (tmp_path / "damaged.mcap").write_bytes(content)
    status, out, _ = verify(tmp_path / "damaged.mcap")
    assert status == 1
    assert "  damage       1 damaged chunk left out" in out
    assert json.loads(verify(log, "--json")[1])["damage"] is None
