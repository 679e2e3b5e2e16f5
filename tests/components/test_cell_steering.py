from pathlib import Path

import numpy as np
import pytest

from symaware_cli import ScenarioError, load, open_log

DELIVER = Path(__file__).parents[2] / "scenarios" / "deliver.yaml"
MODELS = {"single-integrator": 2, "unicycle": 3}


def outside(log: Path) -> np.ndarray:
    """How far the robot is outside its cell and the next one at each step [m], from its true path and the plan."""
    bounds = load(DELIVER).knowledge_models()["floor"].bounds
    plan, robot = open_log(log).series("robot", "decide.plan"), open_log(log).series("robot", "state")
    found = []
    for time, point in zip(robot.times.tolist(), robot.values[:, :2], strict=True):
        decided = plan.values[max(np.searchsorted(plan.times, time, "left") - 1, 0)]
        apart = [point - np.clip(point, *bounds[int(cell)].T) for cell in decided[:2]]
        found.append(min(float(np.linalg.norm(each)) for each in apart))
    return np.array(found)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("seed", range(4))
def test_from_anywhere_in_a_cell_the_next_is_reached_without_leaving_the_two(
    tmp_path: Path, model: str, seed: int
) -> None:
    x, y, heading, speed = np.random.default_rng(seed).uniform([0, 0, -np.pi, 0.2], [6, 1, np.pi, 2.0]).tolist()
    changes = {
        "agents.robot.state": [x, y, heading][: MODELS[model]],
        "agents.robot.model": {"use": model, "with": {"max_speed": 2.0}},
        "agents.robot.components.steer.with.speed": speed,
        "run.duration": 15.0,
    }
    assert load(DELIVER, changes).run(output=tmp_path / "a.mcap").status == "finished"
    assert outside(tmp_path / "a.mcap").max() < 1e-6
    plan = open_log(tmp_path / "a.mcap").series("robot", "decide.plan").values
    decided = plan[np.isfinite(plan[:, 0])]
    assert len(set(decided[:, 0].tolist())) > 1
    entered = decided[1:, 0] != decided[:-1, 0]
    assert (decided[1:, 0][entered] == decided[:-1, 1][entered]).all()  # no cell is skipped
    assert not [each for each in open_log(tmp_path / "a.mcap").events() if each.name == "both-cells-left"]


@pytest.mark.parametrize("world", ["pymunk", "pybullet"])
@pytest.mark.parametrize("state", [[0.9, 0.05, 1.0], [3.1, 0.5, -2.0]])
def test_where_forces_move_bodies_each_excursion_is_an_event_and_nothing_else_is(
    tmp_path: Path, world: str, state: list[float]
) -> None:
    changes = {"environment.use": world, "agents.robot.state": state, "run.duration": 15.0}
    assert load(DELIVER, changes).run(output=tmp_path / "a.mcap").status == "finished"
    is_out = outside(tmp_path / "a.mcap") > 1e-6
    left = [each.name for each in open_log(tmp_path / "a.mcap").events() if each.name == "both-cells-left"]
    assert len(left) == np.count_nonzero(is_out[1:] & ~is_out[:-1]) + is_out[0]


def test_held_inputs_carry_an_agent_beyond_both_cells_and_that_is_an_event(tmp_path: Path) -> None:
    changes = {"agents.robot.components.steer.period": 3.0, "run.duration": 30.0}
    load(DELIVER, changes).run(output=tmp_path / "a.mcap")
    assert outside(tmp_path / "a.mcap").max() > 0.1
    events = [each for each in open_log(tmp_path / "a.mcap").events() if each.name == "both-cells-left"]
    assert events
    assert events[0].data["distance"] > 1e-6


def test_noise_is_refused_at_the_controller() -> None:
    changes = {
        "agents.robot.model": {"use": "single-integrator", "with": {"process_noise": 0.01}},
        "agents.robot.state": [0.5, 0.5],
    }
    with pytest.raises(ScenarioError, match="noise does not surely keep") as caught:
        load(DELIVER, changes)
    assert [each.path for each in caught.value.problems] == ["agents.robot.components.steer"]
