"""Random fields of obstacles leave room for agents and goals, and are repeatable."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from simulating import untyped

from symaware_cli.geometry import Array
from symaware_cli.language.build import Built
from symaware_cli.language.problem import Problem
from symaware_cli.studies.batch_simulation import refusal


@pytest.fixture
def field(scenario: dict[str, Any]) -> dict[str, Any]:
    """A robot that crosses a field of discs."""
    shape = {"circle": {"radius": 0.3}}
    scenario["map"] = {
        "scatter": {"count": 40, "shape": shape, "apart": 0.2, "clear": 0.4, "within": [0.0, 10.0, 0.0, 10.0]}
    }
    scenario["agents"]["robot"]["knowledge"] = {"goal": [9.0, 9.0], "waypoints": [[5.0, 5.0], [9.0, 9.0]]}
    return scenario


def places(built: Built) -> Array:
    bodies = built.document.environment.entities
    return np.array([body.position for name, body in bodies.items() if name.startswith("scatter")], float)


def gaps(one: Array, other: Array) -> Array:
    away = one[:, None] - other
    return np.asarray(np.sqrt((away**2).sum(axis=2)))


@pytest.mark.parametrize("seed", range(5))
def test_obstacles_keep_apart_from_each_other_and_from_starts_and_goals(
    seed: int, building: Callable[..., Built], field: dict[str, Any]
) -> None:
    field["seed"] = seed
    found = places(building())
    assert len(found) == 40
    assert (gaps(found, found) + 9.0 * np.eye(40)).min() >= 0.8
    assert gaps(found, np.array([[0.6, 1.0], [9.0, 9.0], [5.0, 5.0]])).min() >= 0.3 + 0.15 + 0.4
    assert found.min() >= 0.0
    assert found.max() <= 10.0


def test_a_seed_repeats_its_field_and_one_obstacle_more_does_not_move_the_others(
    building: Callable[..., Built], field: dict[str, Any]
) -> None:
    first = places(building())
    assert np.array_equal(places(building()), first)
    field["map"]["scatter"]["count"] = 41
    assert np.array_equal(places(building())[:40], first)
    field["seed"] = 1
    assert not np.array_equal(places(building())[:40], first)


def test_a_field_on_a_map_keeps_from_its_walls_and_from_entities(
    building: Callable[..., Built], field: dict[str, Any]
) -> None:
    box = {"box": {"length": 0.2, "width": 0.1}}
    field["map"] = {"file": "room.yaml", "scatter": {"count": 3, "shape": box, "apart": 0.1, "clear": 0.1}}
    field["agents"]["robot"]["knowledge"] = {"goal": [2.0, 0.5]}
    field["environment"]["entities"] = {"post": {"shape": {"circle": {"radius": 0.1}}, "position": [2.0, 1.5]}}
    built = building()
    found = places(built)
    walls = {n: b for n, b in built.document.environment.entities.items() if not n.startswith("scatter")}
    assert len(walls) == 7
    assert gaps(found, np.array([[2.0, 1.5]])).min() >= 0.1 + 0.1 + box["box"]["width"]
    assert "scatter_0" in built.simulation.environment.scenery.names
    (area,) = built.simulation.groups[0].regions["occupied"].members
    assert len(untyped(area).union) == 9


@pytest.mark.parametrize(
    ("changes", "said", "path"),
    [
        ({"count": 400}, "obstacles have room, and no place was found for another", "map.scatter"),
        ({"clear": 20.0}, "0 of 40 obstacles have room", "map.scatter"),
        ({"within": None}, "without a file, the area is needed", "map.scatter"),
        ({"within": [0.0, 1.0, 1.0, 1.0]}, "the least of a coordinate is not below its greatest", "map.scatter.within"),
        ({"count": 0}, "`map.scatter.count` is 0", "map.scatter.count"),
        ({"count": 10**9}, "`map.scatter.count` is 1000000000", "map.scatter.count"),
        ({"apart": -1.0}, "`map.scatter.apart` is -1", "map.scatter.apart"),
        ({"shape": {"wall": {"points": [[0, 0], [1, 1]]}}}, "a wall cannot be scattered", "map.scatter.shape.wall"),
    ],
)
def test_an_impossible_field_is_refused_at_its_place(
    changes: dict[str, Any], said: str, path: str, problems: Callable[..., list[Problem]], field: dict[str, Any]
) -> None:
    field["map"]["scatter"] |= changes
    (problem,) = problems()
    assert said in problem.message
    assert problem.path == path


def test_runs_with_fields_are_not_batched(building: Callable[..., Built], field: dict[str, Any]) -> None:
    field["agents"]["robot"]["components"]["sense"] = {"use": "perception.omniscient"}
    assert refusal(building()) == "the section `map` draws other bodies in each run"
