"""A tilted entity is tilted in replays, for Foxglove and, seen from above, in plots."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import export_foxglove
from foxglove_files import frames, read
from plot_logs import log_of
from rerun_files import saved
from scipy.spatial.transform import Rotation

from symaware_cli import Log
from symaware_cli.views.views import run_view_of

SCENARIO = """
symaware: 1
name: slope
seed: 1
run: {duration: 0.4}
environment:
  use: pybullet
  with: {time_step: 0.05}
  entities:
    ramp: {shape: {box: {length: 8, width: 3, height: 0.2}}, position: [0, 0, 2], heading: 0.4, pitch: 0.5, roll: 0.1}
    lift:
      shape: {box: {length: 2, width: 1, height: 0.2}}
      pitch: -0.3
      path: {times: [0, 1], positions: [[9, 0, 2], [9, 1, 2]], headings: [0.2, 0.6]}
    crate: {shape: {box: {length: 0.4, width: 0.4, height: 0.4}}, position: [0, 0, 4], roll: 0.7, mass: 1.0}
"""
RAMP = Rotation.from_euler("ZYX", [0.4, 0.5, 0.1])


@pytest.fixture(scope="module")
def slope(tmp_path_factory: pytest.TempPathFactory) -> tuple[Log, Path]:
    folder = tmp_path_factory.mktemp("slope")
    return log_of(folder, SCENARIO), folder


def apart(quaternion: Any, rotation: Rotation) -> float:
    return float((Rotation.from_quat(quaternion) * rotation.inv()).magnitude())


def test_the_log_has_the_tilt_of_bodies(slope: tuple[Log, Path]) -> None:
    log, _ = slope
    assert log.manifest["entities"]["ramp"]["pitch"] == 0.5
    assert apart(log.series("crate", "pose").values[0, 3:], Rotation.from_euler("x", 0.7)) < 1e-9


def test_a_replay_draws_them_tilted(slope: tuple[Log, Path]) -> None:
    log, folder = slope
    recording = saved(log, folder)

    def turned(name: str) -> list[Any]:
        (path,) = (each for each in recording.entities if each.startswith(f"/world/scenery/{name}/"))
        return recording.values(path, "InstancePoses3D:quaternions")

    assert apart(turned("ramp")[0][0], RAMP) < 1e-6
    assert apart(turned("crate")[0][0], Rotation.from_euler("x", 0.7)) < 1e-6
    assert apart(turned("lift")[0][0], Rotation.from_euler("ZYX", [0.2, -0.3, 0.0])) < 1e-6
    assert apart(turned("lift")[-1][0], Rotation.from_euler("ZYX", [0.2 + 0.4 * 0.4, -0.3, 0.0])) < 1e-6


def test_foxglove_shows_tilted_bodies(slope: tuple[Log, Path]) -> None:
    log, folder = slope
    export_foxglove(log, folder / "foxglove.mcap")
    messages = read(folder / "foxglove.mcap")
    _, _, rotation = frames(messages["/tf/ramp"][0][1])["ramp"]
    assert (rotation * RAMP.inv()).magnitude() < 1e-6
    _, _, rotation = frames(messages["/tf/lift"][0][1])["lift"]
    assert (rotation * Rotation.from_euler("ZYX", [0.2, -0.3, 0.0]).inv()).magnitude() < 1e-6


def test_seen_from_above_they_cover_more_or_less_than_upright(slope: tuple[Log, Path]) -> None:
    log, _ = slope
    obstacle_views = run_view_of(log).obstacle_views
    corners = np.array(obstacle_views["ramp"].shape.pieces[0][0])
    assert len(corners) == 6  # all but two of the eight that a box has
    along = 8 * np.cos(0.5) + 3 * np.sin(0.5) * np.sin(0.1) + 0.2 * np.sin(0.5) * np.cos(0.1)
    assert np.ptp(corners[:, 0]) == pytest.approx(along, abs=1e-4)
    assert np.ptp(np.array(obstacle_views["crate"].shape.pieces[0][0])[:, 0]) == pytest.approx(0.4)
