"""Warnings of MuJoCo end a run with a message, and write no file beside the scenario."""

from pathlib import Path
from typing import Any

import pytest

import symaware_cli as sa

pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")


def scenario(entities: dict[str, Any], **given: Any) -> dict[str, Any]:
    return {
        "symaware": 1,
        "name": "s",
        "run": {"duration": 20.0},
        "environment": {"use": "mujoco", "entities": entities, "with": given},
    }


def ball(x: float, **given: Any) -> dict[str, Any]:
    return {"shape": {"circle": {"radius": 0.1}}, "position": [x, 0, 1], "mass": 1.0, **given}


def test_a_world_that_becomes_unstable_ends_its_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    # After 4.5 s the ball is so far away that the engine takes its position for an error.
    falling = scenario({"a": ball(0)}, time_step=0.1, substeps=1, ground=None, gravity=[0, 0, -1e9])
    with pytest.raises(sa.RunFailedError, match=r"unstable.*raise `substeps`"):
        sa.scenario(falling).run(output="unstable.mcap")
    failure = [event for event in sa.open_log("unstable.mcap").events() if event.name == "failed"]
    assert [event.time == 4_500_000_000 for event in failure] == [True]
    assert [path.name for path in tmp_path.iterdir()] == ["unstable.mcap"]
    assert capfd.readouterr().err == ""


def test_another_world_in_the_same_process_is_not_ended() -> None:
    falling = scenario({"a": ball(0)}, time_step=0.1, substeps=1, ground=None, gravity=[0, 0, -1e9])
    with pytest.raises(sa.RunFailedError):
        sa.scenario(falling).run(record=False)
    resting = scenario({"a": ball(0)}, time_step=0.1)
    assert sa.scenario(resting).run(record=False).status == "finished"


def test_a_heap_of_a_hundred_overlapping_bodies_fits_into_the_memory() -> None:
    heap = {f"b{number}": ball(number * 1e-3) for number in range(100)}
    built = scenario(heap, time_step=0.01, substeps=1)
    built["run"]["duration"] = 0.02
    assert sa.scenario(built).run(record=False).status == "finished"
