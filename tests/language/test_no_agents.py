"""Scenarios without agents: the world moves, and its log can be inspected like any other."""

from pathlib import Path

import pytest
import yaml

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.files import open_scenario
from symaware_cli.log.digest import digest
from symaware_cli.log.overview import overview_of

BALL = {"shape": {"circle": {"radius": 0.2}}, "position": [0, 0], "mass": 1.0, "velocity": [1.0, 0.0]}
BUS = {"shape": {"circle": {"radius": 0.2}}, "path": {"times": [0, 1], "positions": [[5, 0], [6, 0]]}}


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
@pytest.mark.parametrize(
    ("world", "body"), [("kinematic", BUS), ("pymunk", BALL), ("pybullet", BALL), ("pybullet", BUS)], ids=str
)
def test_bodies_move_on_their_own_and_a_log_repeats_it(world: str, body: str, mode: str, tmp_path: Path) -> None:
    content = {"symaware": 1, "name": "alone", "run": {"duration": 1.0, "mode": mode}}
    content["environment"] = {"use": world, "entities": {"thing": body}}
    (tmp_path / "alone.yaml").write_text(yaml.safe_dump(content))
    summary = execute(build(tmp_path / "alone.yaml"), tmp_path / "first.mcap")
    assert (summary.status, summary.agents, summary.steps) == ("finished", 0, 20)
    log = open_log(tmp_path / "first.mcap")
    x = log.series("thing", "world").column("x")
    assert 0.5 < x[-1] - x[0] < 1.05  # on the ground, a ball slides before it rolls
    assert overview_of(log).agents == {}
    execute(open_scenario(tmp_path / "first.mcap"), tmp_path / "again.mcap")
    assert digest(open_log(tmp_path / "again.mcap")).combined == digest(log).combined
