from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT

from symaware_cli import ScenarioError, load, open_log
from symaware_cli.core import Drive
from symaware_cli.worlds.planar import PymunkEnvironment

DELIVER = CHECKOUT / "scenarios" / "deliver.yaml"
MODELS = {"single-integrator": 2, "unicycle": 3}
WORLDS = ["kinematic", "pymunk", "pybullet"]
STEER = "agents.robot.components.steer"
SENSE = "agents.robot.components.sense"

#: A robot that patrols between three cells.
PATROL = """
symaware: 1
name: patrol
run: {duration: 20.0}
environment: {use: kinematic, with: {time_step: 0.1}}
regions:
  arena: {box: [0, 5, 0, 3]}
  a: {box: [0, 1, 0, 1]}
  b: {box: [4, 5, 0, 1]}
  c: {box: [2, 3, 2, 3]}
knowledge_models:
  floor: {use: abstraction.grid, with: {cell: 1.0, region: arena}}
agents:
  robot:
    entity: {shape: {circle: {radius: 0.3}}, mass: 2.0}
    model: {use: single-integrator}
    state: [0.5, 0.5]
    components:
      sense: {use: perception.self}
      decide:
        use: knowledge.strategy
        with: {model: floor, guarantees: [always eventually a, always eventually b, always eventually c]}
      steer: {use: control.cells, with: {model: floor}}
"""


def outside(log: Path, scenario: Path = DELIVER) -> np.ndarray:
    """How far the robot is outside its cell and the next one at each step [m], from its true path and the plan."""
    bounds = load(scenario).knowledge_models()["floor"].bounds
    plan, robot = open_log(log).series("robot", "decide.plan"), open_log(log).series("robot", "state")
    found = []
    for time, point in zip(robot.times.tolist(), robot.values[:, :2], strict=True):
        decided = plan.values[max(np.searchsorted(plan.times, time, "left") - 1, 0)]
        apart = [point - np.clip(point, *bounds[int(cell)].T) for cell in decided[:2]]
        found.append(min(float(np.linalg.norm(each)) for each in apart))
    return np.array(found)


def entered(log: Path) -> int:
    """How many cells the robot came to, each of which was the one that it was going to."""
    plan = open_log(log).series("robot", "decide.plan").values
    decided = plan[np.isfinite(plan[:, 0])]
    is_new = decided[1:, 0] != decided[:-1, 0]
    assert (decided[1:, 0][is_new] == decided[:-1, 1][is_new]).all(), "a cell was skipped"
    return int(is_new.sum())


def events(log: Path, *names: str) -> list[Any]:
    return [each for each in open_log(log).events() if each.name in names]


def patrol(folder: Path, changes: Mapping[str, Any]) -> Path:
    (folder / "patrol.yaml").write_text(PATROL)
    assert load(folder / "patrol.yaml", changes).run(output=folder / "a.mcap").status == "finished"
    return folder / "a.mcap"


def drawn(world: str, seed: int) -> dict[str, Any]:
    """Parameters at random: of the world, the body, the model and the timing."""
    random = np.random.default_rng([seed, WORLDS.index(world)])
    model, step = str(random.choice(list(MODELS))), float(random.choice([0.05, 0.1, 0.25]))
    mass, radius, speed = random.uniform([0.5, 0.1, 0.2], [20.0, 0.4, 3.0]).tolist()
    limits: dict[str, float] = {"max_speed": float(random.uniform(0.5, 3.0))}
    if model == "unicycle":
        limits["max_turn_rate"] = float(random.uniform(0.5, 20.0))
    body: dict[str, Any] = {"shape": {"circle": {"radius": radius}}, "mass": mass}
    if random.random() < 0.7:
        body["max_force"] = mass * float(10 ** random.uniform(-1.0, 1.3))
    if random.random() < 0.7:
        body["max_torque"] = 0.5 * mass * radius**2 * float(10 ** random.uniform(-1.0, 1.5))
    state = random.uniform([0, 0, -4], [5, 3, 4]).tolist()[: MODELS[model]]
    changes = {
        "run.mode": str(random.choice(["synchronous", "asynchronous"])),
        "environment": {"use": world, "with": {"time_step": step}},
        "agents.robot.entity": body,
        "agents.robot.model": {"use": model, "with": limits},
        "agents.robot.state": state,
        "agents.robot.components.decide.period": float(random.choice([step, 0.3, 0.5])),
        f"{STEER}.period": step * int(random.choice([1, 1, 2, 5])),
        f"{STEER}.with.speed": speed,
    }
    if world != "kinematic":
        changes["environment.with.substeps"] = int(random.choice([1, 2, 3, 10]))
    return changes


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("seed", range(4))
def test_from_anywhere_in_a_cell_the_next_is_reached_without_leaving_the_two(
    tmp_path: Path, model: str, seed: int
) -> None:
    x, y, heading, speed = np.random.default_rng(seed).uniform([0, 0, -np.pi, 0.2], [6, 1, np.pi, 2.0]).tolist()
    changes = {
        "agents.robot.state": [x, y, heading][: MODELS[model]],
        "agents.robot.model": {"use": model, "with": {"max_speed": 2.0}},
        f"{STEER}.with.speed": speed,
        "run.duration": 15.0,
    }
    assert load(DELIVER, changes).run(output=tmp_path / "a.mcap").status == "finished"
    assert outside(tmp_path / "a.mcap").max() < 1e-6
    assert entered(tmp_path / "a.mcap") > 0
    assert not events(tmp_path / "a.mcap", "cells-left", "cell-skipped")


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("seed", [*range(5), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(5, 15))])
def test_a_certificate_holds_in_every_world_for_any_parameters(tmp_path: Path, world: str, seed: int) -> None:
    log = patrol(tmp_path, drawn(world, seed))
    assert outside(log, tmp_path / "patrol.yaml").max() < 2e-6
    assert entered(log) > 0
    assert not events(log, "cells-left", "cell-skipped", "touched")


@pytest.mark.parametrize(("lie", "force"), [(Drive(0.25), None), (Drive(0.25, lag=0.25), 2.0)])
def test_a_drive_other_than_that_of_the_world_takes_agents_out_of_their_cells(
    tmp_path: Path, lie: Drive, force: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PymunkEnvironment, "drive", lambda self, group: lie)
    changes = {
        "environment": {"use": "pymunk", "with": {"time_step": 0.25, "substeps": 1}},
        "agents.robot.entity.max_force": force,
        "agents.robot.state": [0.5, 0.01],
        f"{STEER}.with.speed": 5.0,
    }
    log = patrol(tmp_path, changes)
    assert outside(log, tmp_path / "patrol.yaml").max() > 0.1
    assert all(each.data["distance"] > 2e-6 for each in events(log, "cells-left"))
    assert events(log, "cells-left", "cell-skipped")


def test_control_inputs_held_for_too_long_are_refused_or_take_agents_out_of_their_cells(tmp_path: Path) -> None:
    changes = {f"{STEER}.latency": 0.4, f"{STEER}.with.speed": 3.0}
    with pytest.raises(ScenarioError, match="an input is for where the agent was when it was computed"):
        patrol(tmp_path, changes)
    log = patrol(tmp_path, {**changes, f"{STEER}.with.certified": False, "run.mode": "asynchronous"})
    assert outside(log, tmp_path / "patrol.yaml").max() > 0.1
    left = events(log, "cells-left")
    assert left
    assert left[0].data["distance"] > 1e-6
    assert left[0].data["cell"] != left[0].data["next_cell"]


WALL = {"shape": {"box": {"length": 0.8, "width": 0.2}}, "position": [1.5, -0.35]}


@pytest.mark.parametrize(
    ("changes", "place", "said"),
    [
        ({f"{STEER}.period": 0.25}, f"{STEER}.period", "held for a part of a time step"),
        ({f"{STEER}.period": 0.2, f"{STEER}.offset": 0.05}, f"{STEER}.offset", "held for a part of a time step"),
        ({f"{STEER}.period": 0.2, f"{STEER}.jitter": 0.1}, f"{STEER}.jitter", "the time for which an input is held"),
        ({f"{STEER}.condition": "risk < 0.5"}, f"{STEER}.condition", "while the condition does not hold"),
        ({f"{STEER}.trigger": {"event": "goal-met", "of": "decide"}}, f"{STEER}.trigger", "until an event"),
        ({"agents.robot.components.sense.period": 0.2}, SENSE, "its own exact state"),
        (
            {"agents.robot.components.sense": {"use": "perception.range", "with": {"range": 1.0, "self_noise": 0.1}}},
            SENSE,
            "its own exact state",
        ),
        (
            {"agents.robot.model.with": {"process_noise": 0.01}},
            STEER,
            "noise does not surely keep",
        ),
        (
            {"agents.robot.components.more": {"use": "control.random", "with": {"inputs": [[0.0, 0.0]]}}},
            "agents.robot.components.more",
            "changes the control input as well",
        ),
        (
            {"environment.use": "pymunk", "environment.with.damping": 0.1, "agents.robot.entity.max_force": 1.0},
            "environment.with.damping",
            "has to overcome the damping",
        ),
        (
            {"environment.use": "pymunk", "environment.entities": {"wall": WALL}},
            "environment.entities.wall",
            "`wall` is 0.25 m from the cell `c1_0`, and the body reaches 0.3 m",
        ),
        (
            {"environment.use": "pymunk", "environment.entities": {"crate": {**WALL, "mass": 1.0}}},
            STEER,
            "`crate` might touch it",
        ),
        ({"environment.use": "pybullet", "agents.robot.count": 2}, STEER, "`robot.0`, `robot.1` might touch it"),
        ({f"{STEER}.with.apart_from": ["nobody"]}, f"{STEER}.with.apart_from[0]", "no agent, group or entity `nobody`"),
    ],
)
def test_causes_of_uncertainty_are_refused_at_their_place(
    tmp_path: Path, changes: dict[str, Any], place: str, said: str
) -> None:
    with pytest.raises(ScenarioError, match=said) as caught:
        patrol(tmp_path, changes)
    assert [each.path for each in caught.value.problems] == [place]
    if "apart_from" not in place:
        patrol(tmp_path, {**changes, f"{STEER}.with.certified": False, "run.duration": 1.0})


def test_a_wall_beyond_the_body_is_no_danger_nor_is_one_in_a_world_without_contacts(tmp_path: Path) -> None:
    far = {**WALL, "position": [1.5, -0.41]}
    patrol(tmp_path, {"environment.use": "pymunk", "environment.entities": {"wall": far}})
    patrol(tmp_path, {"environment.entities": {"wall": WALL}})


@pytest.mark.parametrize("world", ["pymunk", "pybullet"])
def test_a_body_that_was_said_to_keep_apart_and_does_not_is_an_event(tmp_path: Path, world: str) -> None:
    crate = {"shape": {"box": {"length": 0.3, "width": 0.3, "height": 0.3}}, "position": [2.5, 0.5], "mass": 1.0}
    changes = {
        "environment.use": world,
        "environment.entities": {"crate": crate},
        f"{STEER}.with.apart_from": ["crate"],
        "agents.robot.entity.shape": {"cylinder": {"radius": 0.3, "height": 0.3}} if world == "pybullet" else {},
    }
    log = patrol(tmp_path, {name: value for name, value in changes.items() if value})
    touched = events(log, "touched")
    assert touched
    assert touched[0].data["by"] == "crate"


def test_a_skipped_cell_is_an_event_that_names_the_cells(tmp_path: Path) -> None:
    changes = {
        STEER: {"use": "control.random", "with": {"inputs": [[1.0, 0.0]]}},
        "agents.robot.components.decide.with.guarantees": ["always eventually up"],
        "agents.robot.components.decide.period": 0.5,
        "regions.up": {"box": [0, 1, 2, 3]},
        "run.duration": 2.0,
    }
    skipped, *more = events(patrol(tmp_path, changes), "cell-skipped", "cells-left")
    assert skipped.name == "cell-skipped"
    assert skipped.data == {"cell": "c0_0", "skipped": "c0_1", "reached": "c1_0"}
    assert not more


@pytest.mark.parametrize("world", WORLDS)
def test_a_limited_force_does_not_stop_the_body_where_its_way_goes_straight_on(tmp_path: Path, world: str) -> None:
    body = {"agents.robot.entity.max_force": 2.0} if world != "kinematic" else {}
    changes = {"environment.use": world, f"{STEER}.with.speed": 1.0, "run.duration": 6.0, **body}
    control = open_log(patrol(tmp_path, changes)).series("robot", "applied_control").values
    speed = np.hypot(*control[:, :2].T)
    assert speed[10:25].min() > 0.8  # from one centre to the next, past two sides
    assert speed.max() == pytest.approx(1.0)


def test_in_a_process_of_its_own_it_steers_as_here(tmp_path: Path) -> None:
    changes = {
        "environment.use": "pymunk",
        "run.mode": "asynchronous",
        "run.duration": 3.0,
        "agents.robot.entity.max_force": 2.0,
        f"{STEER}.period": 0.2,
    }
    here = open_log(patrol(tmp_path, changes)).series("robot", "state").values
    (tmp_path / "a.mcap").unlink()
    there = open_log(patrol(tmp_path, {**changes, f"{STEER}.run_in": "process"})).series("robot", "state").values
    assert here.tobytes() == there.tobytes()
