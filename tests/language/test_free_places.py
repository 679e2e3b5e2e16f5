"""Agents and goals that are placed in the free space of a scenario."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import symaware_cli as sa
from symaware_cli.geometry import Scenery
from symaware_cli.language.build import Built, build
from symaware_cli.studies.batch_simulation import refusal

RADIUS = 0.2
GROUP: dict[str, Any] = {
    "count": 5,
    "entity": {"shape": {"circle": {"radius": RADIUS}}},
    "model": {"use": "unicycle"},
    "state": {"free": {"apart": 1.0, "within": [0, 10, 0, 10]}},
    "knowledge": {"goal": {"free": {"within": [0, 10, 0, 10]}}},
}
BLOCK = {"shape": {"box": {"length": 4.0, "width": 6.0}}, "position": [5.0, 5.0]}


def written(folder: Path, groups: dict[str, Any] | None = None, **changes: Any) -> Path:
    document = {
        "symaware": 1,
        "name": "free",
        "run": {"duration": 1.0},
        "environment": {"use": "kinematic", "entities": {"block": BLOCK}},
        "agents": groups or {"robot": GROUP},
        **changes,
    }
    path = folder / "free.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path


def starts(built: Built, name: str = "robot") -> np.ndarray:
    return next(group.initial_state for group in built.simulation.groups if group.name == name)


def goals(built: Built, name: str = "robot") -> np.ndarray:
    return next(group.known("goal") for group in built.simulation.groups if group.name == name)


def least_distance(points: np.ndarray) -> float:
    return min(float(np.linalg.norm(one - other)) for one, other in combinations(points[:, :2], 2))


def problem(path: Path, **options: Any) -> str:
    with pytest.raises(sa.ScenarioError) as caught:
        build(path, **options)
    return "\n".join(f"{each.path}: {each.message}" for each in caught.value.problems)


@pytest.mark.parametrize("seed", range(5))
def test_bodies_keep_clear_of_obstacles_and_apart_from_each_other(tmp_path: Path, seed: int) -> None:
    built = build(written(tmp_path), seed=seed)
    obstacles = Scenery(built.document.environment.entities)
    for points, apart in ((starts(built), 1.0), (goals(built), 0.5)):
        assert ((points[:, :2] >= 0.0) & (points[:, :2] <= 10.0)).all()
        assert least_distance(points) >= 2.0 * RADIUS + apart
        assert not len(obstacles.nearest(points[:, :2], RADIUS + 0.2).row)


def test_a_seed_reproduces_its_places_and_another_seed_differs(tmp_path: Path) -> None:
    path = written(tmp_path)
    one, again, other = (build(path, seed=seed) for seed in (1, 1, 2))
    assert starts(one).tobytes() == starts(again).tobytes()
    assert goals(one).tobytes() == goals(again).tobytes()
    assert not (starts(one) == starts(other)).any()


def test_another_agent_does_not_move_earlier_ones(tmp_path: Path) -> None:
    path = written(tmp_path)
    few, many = build(path), build(path, ["agents.robot.count=8"])
    assert (starts(many)[:5] == starts(few)).all()


def test_groups_keep_apart_from_each_other_and_from_given_places(tmp_path: Path) -> None:
    given = {**GROUP, "count": 2, "state": [[1, 1, 0], [9, 9, 0]], "knowledge": {}}
    built = build(written(tmp_path, {"a": GROUP, "b": GROUP, "z": given}), seed=4)
    everybody = np.concatenate([starts(built, name) for name in ("a", "b", "z")])
    assert least_distance(everybody) >= 2.0 * RADIUS + 1.0


def test_places_are_within_a_region_and_outside_of_others(tmp_path: Path) -> None:
    regions = {"ring": {"circle": {"centre": [5, 5], "radius": 5.0}}, "south": {"box": [0, 10, 0, 5]}}
    state = {"free": {"within": "ring", "outside": ["south"], "heading": 0.5}}
    built = build(written(tmp_path, {"robot": {**GROUP, "state": state}}, regions=regions))
    found = starts(built)
    assert (np.linalg.norm(found[:, :2] - 5.0, axis=1) <= 5.0).all()
    assert (found[:, 1] >= 5.0 + RADIUS + 0.2).all()
    assert (found[:, 2] == 0.5).all()


def test_agents_are_placed_between_the_obstacles_of_a_random_field(tmp_path: Path) -> None:
    field = {"count": 20, "shape": {"circle": {"radius": 0.5}}, "within": [0, 12, 0, 12]}
    group = {**GROUP, "state": {"free": {}}, "knowledge": {"waypoints": [{"free": {}}, {"free": {}}]}}
    built = build(written(tmp_path, {"robot": group}, map={"scatter": field}), seed=3)
    obstacles = Scenery(built.document.environment.entities)
    assert len(built.document.environment.entities) == 21
    known = built.simulation.groups[0].known("waypoints").reshape(-1, 2)
    for points in (starts(built)[:, :2], known):
        assert least_distance(points) >= 2.0 * RADIUS + 0.5
        assert not len(obstacles.nearest(points, RADIUS + 0.2).row)


def test_agents_keep_out_of_unknown_parts_of_a_map(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(
        "{image: map.pgm, resolution: 1.0, origin: [0, 0, 0], negate: 0, occupied_thresh: 0.65, free_thresh: 0.2}"
    )
    (tmp_path / "map.pgm").write_bytes(b"P5 8 8 255\n" + (bytes([254] * 4) + bytes([128] * 4)) * 8)
    group = {**GROUP, "state": {"free": {}}, "knowledge": {}}
    built = build(written(tmp_path, {"robot": group}, map={"file": "map.yaml"}))
    assert (starts(built)[:, 0] <= 4.0).all()


def test_single_agents_may_have_given_places(tmp_path: Path) -> None:
    built = build(written(tmp_path), ["agents.robot[1].state=[9, 1, 0]"])
    assert starts(built)[1].tolist() == [9.0, 1.0, 0.0]
    assert least_distance(starts(built)) >= 2.0 * RADIUS + 1.0


@pytest.mark.parametrize(
    ("state", "said"),
    [
        ({"apart": 9.0, "within": [0, 10, 0, 10]}, "has no room, as no place was found for it in 1000 draws"),
        ({}, "it needs an area"),
        ({"within": "nowhere"}, "there is no region `nowhere`"),
        ({"within": "around"}, "the region `around` moves with an agent"),
        ({"within": [1, 0, 0, 1]}, "the least of a coordinate is not below its greatest"),
        ({"within": [0, 10, 0, 10], "apart": -1}, "agents.robot.state.free.apart"),
    ],
)
def test_impossible_placements_are_refused_at_their_place(tmp_path: Path, state: Any, said: str) -> None:
    regions = {"around": {"circle": {"centre": [0, 0], "radius": 1.0}, "around": "robot.0"}}
    path = written(tmp_path, {"robot": {**GROUP, "state": {"free": state}}}, regions=regions)
    found = problem(path)
    assert said in found
    assert "agents.robot.state.free" in found


def test_faults_do_not_place_agents(tmp_path: Path) -> None:
    faults = {"new": {"at": 0.5, "inform": {"of": "robot", "knowledge": {"goal": {"free": {"within": [0, 1, 0, 1]}}}}}}
    assert "only when a run begins" in problem(written(tmp_path, faults=faults))


def test_runs_with_free_places_are_not_batched(tmp_path: Path) -> None:
    said = refusal(build(written(tmp_path)))
    assert said == "agents or goals of `robot` are placed in the free space of each run"


def test_a_log_repeats_its_run_and_a_state_is_restored(tmp_path: Path) -> None:
    components = {"sense": {"use": "perception.self"}, "steer": {"use": "control.go-to-goal"}}
    path = written(tmp_path, {"robot": {**GROUP, "components": components}})
    run = sa.load(path).run(output=tmp_path / "free.mcap")
    assert run.log_path is not None
    assert sa.verify_log(run.log_path).is_equal
    with sa.load(path).start() as simulation, sa.load(path).start() as other:
        simulation.step(7)
        other.restore(sa.SimulationState.from_bytes(simulation.capture().to_bytes()))
        assert other.state("robot").tobytes() == simulation.state("robot").tobytes()
