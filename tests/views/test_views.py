"""Who takes part in a log."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plot_logs import AIRCRAFT, YARD, log_of
from rerun_files import Script, group

from symaware_cli import open_log
from symaware_cli.log.error import LogError
from symaware_cli.views.views import in_space, run_view_of


def test_everybody_is_there_with_body_model_and_colour(tmp_path: Path) -> None:
    run_view = run_view_of(log_of(tmp_path, YARD))
    assert list(run_view.agents) == ["cart.0", "cart.1", "guard"]
    assert run_view.place["cart.1"] == ("cart", 1)
    assert run_view.group_views["cart"].radius == pytest.approx(np.hypot(0.4, 0.2))
    assert (run_view.group_views["cart"].heading, run_view.group_views["guard"].heading) == (2, None)
    assert set(run_view.obstacle_views) == {"pillar", "fence", "gate"}
    assert [run_view.obstacle_views[name].moves for name in ("pillar", "fence", "gate")] == [False, False, True]
    assert not run_view.is_spatial


def test_a_flying_agent_makes_the_world_spatial(tmp_path: Path) -> None:
    run_view = run_view_of(log_of(tmp_path, AIRCRAFT))
    assert run_view.is_spatial
    assert run_view.group_views["plane"].positions(np.array([[1.0, 2.0, 3.0, 0.5]])).tolist() == [[1.0, 2.0, 3.0]]


def test_how_far_they_see_is_in_the_scenario_that_the_log_keeps(scenarios: Path, tmp_path: Path) -> None:
    assert (
        run_view_of(log_of(tmp_path, "noisy.yaml", "run.duration=0.1")).group_views["straight"].perception_range == 5.0
    )


@pytest.mark.parametrize("scenario", [b"", b"[", b"3", b"agents: 3", b"agents: {a: {components: [1]}}", b"\xff"])
def test_a_scenario_without_a_range_of_perception_is_accepted(scenario: bytes, tmp_path: Path) -> None:
    script = Script(tmp_path / "a.mcap", {"a": group("a")})
    script.attach("resolved.yaml", scenario)
    assert run_view_of(script.finish()).group_views["a"].perception_range is None


def test_where_the_truth_was_left_out_belief_stands_for_it(tmp_path: Path) -> None:
    log = log_of(tmp_path, YARD, "recording.omit=[world]")
    assert run_view_of(log).group_views["cart"].state_topic == "/agents/cart/state"


@pytest.mark.parametrize("damage", [{"groups": {"a": {"agents": ["a"]}}}, {"entities": {"b": {}}}, {"roster": None}])
def test_an_incomplete_manifest_is_reported(damage: dict[str, Any], tmp_path: Path) -> None:
    from symaware_cli.log.writer import LogWriter

    content = {"format": 1, "name": "a", "seed": 1, "groups": {}, "entities": {}, "roster": []} | damage
    writer = LogWriter(tmp_path / "a.mcap")
    writer.attach("manifest.json", "application/json", json.dumps(content).encode())
    writer.finish({})
    with pytest.raises(LogError, match=r"manifest in .* is damaged"):
        run_view_of(open_log(tmp_path / "a.mcap"))


def test_a_plane_lies_at_height_zero() -> None:
    assert in_space(np.array([[1.0, 2.0]])).tolist() == [[1.0, 2.0, 0.0]]
    assert in_space(np.array([1.0, 2.0, 3.0])).tolist() == [1.0, 2.0, 3.0]
