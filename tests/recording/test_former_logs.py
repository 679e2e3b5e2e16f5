"""Logs that an earlier release wrote are still read.

`former/requested-control.mcap` was written by the commit 108392e. It has a channel for each entity that moves, and in
place of two channels for the requested and the applied control input, one of messages that no longer exist.
"""

import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from symaware_cli import open_log

LOG = Path(__file__).parent / "former" / "requested-control.mcap"

VERBS = {
    "inspect": [],
    "export": ["--format", "parquet", "--output", "tables"],
    "plot": ["--output", "figure.png"],
    "replay": ["--save", "replay.rrd"],
    "recover": ["--output", "recovered.mcap"],
    "run": ["--no-record"],
}


def test_the_control_input_that_was_requested_is_read() -> None:
    series = open_log(LOG).series("robot", "control_requested")
    assert series.columns == ("speed", "turn_rate")
    assert series.values.shape == (15, 3, 2)
    assert series.values[0, :, 0] == pytest.approx(2.0)  # the controller's, beyond the model's limit of 1 m/s


def test_what_was_computed_from_it_is_not_taken_for_what_was_applied() -> None:
    with pytest.raises(Exception, match="has no control of 'robot'"):
        open_log(LOG).series("robot", "control")


def test_entities_with_channels_of_their_own_are_read() -> None:
    series = open_log(LOG).series("cart", "world")
    assert series.values[:, 1] == pytest.approx(np.linspace(-2, -0.5, 16))


def test_messages_and_beliefs_are_read() -> None:
    log = open_log(LOG)
    assert Counter(each.stage for each in log.communications()) == {"SENT": 102, "DELIVERED": 96}
    seen, true = log.beliefs("robot.0", "robot.1"), log.series("robot.1", "world")
    assert seen.columns == ("x", "y", "vx", "vy")
    assert np.abs(seen.values[1:, :2] - true.values[1:-1, :2]).max() < 0.2  # seen with a deviation of 0.05 m
    assert log.verify() is None


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_takes_them(verb: str, tmp_path: Path) -> None:
    if verb == "replay":
        pytest.importorskip("rerun", reason="Rerun is an extra")
    command = [sys.executable, "-m", "symaware_cli", verb, str(LOG), *VERBS[verb]]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
