"""Risk maps: the risk of standing at each place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import symaware_cli as sa


def content(**options: Any) -> dict[str, Any]:
    """Return a scenario in which one robot drives towards another, which has a map around itself."""
    body = {"entity": {"shape": {"circle": {"radius": 0.5}}}, "model": {"use": "single-integrator"}}
    drive = {"use": "control.schedule", "with": {"inputs": [{"time": 0.0, "input": [1.0, 0.0]}]}}
    grid = {"use": "risk.map", "with": {"within": [-6.0, 6.0, -2.0, 2.0], "reach": 20.0, **options}}
    return {
        "symaware": 1,
        "name": "map",
        "run": {"duration": 1.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.5}},
        "agents": {
            "one": {**body, "state": [-4.0, 0.0], "components": {"drive": drive}},
            "two": {**body, "state": [4.0, 0.0], "components": {"see": {"use": "perception.omniscient"}, "map": grid}},
        },
    }


def test_with_exact_beliefs_it_is_where_the_other_will_be(tmp_path: Path) -> None:
    sa.scenario(content(record=0.5, horizon=3.0)).run(output=tmp_path / "run.mcap")
    last = list(sa.open_log(tmp_path / "run.mcap").tables("two", "map.map"))[-1]
    place = -4.0 + last.time / 1e9
    low = np.stack(np.meshgrid(np.arange(-6.0, 6.0, 0.5), np.arange(-2.0, 2.0, 0.5)), axis=-1).reshape(-1, 2)
    centre = low + 0.25
    beyond = centre[:, 0] - np.clip(centre[:, 0], place, place + 3.0)
    swept = np.hypot(beyond, centre[:, 1]) < 1.0
    assert {tuple(each) for each in last.values[:, [0, 2]].tolist()} == {tuple(each) for each in low[swept].tolist()}
    assert (last.values[:, 4] == 1.0).all()
    assert (last.values[:, 1] - last.values[:, 0] == 0.5).all()


def test_maps_are_recorded_at_their_rate(tmp_path: Path) -> None:
    sa.scenario(content(record=1.0)).run(output=tmp_path / "run.mcap", duration=2.5)
    log = sa.open_log(tmp_path / "run.mcap")
    assert [each.time / 1e9 for each in log.tables("two", "map.map")] == [0.0, 1.0, 2.0]
    assert log.series("two", "map.evaluations").values[0, 0] == 24 * 8


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"within": [1.0, 0.0, 0.0, 1.0]}, "the least of a coordinate is not below its greatest"),
        ({"resolution": 0.01}, "cells each, and may have 100,000 together"),
        ({"least": 0.0}, "greater than 0"),
    ],
)
def test_an_impossible_map_is_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(sa.ScenarioError, match=said):
        sa.scenario(content(**options))
