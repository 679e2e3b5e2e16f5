"""A plugin adds a section to scenarios: it is validated, built before the groups, and in the editor's schema."""

import json
from collections.abc import Callable
from importlib import import_module
from typing import Any

import pytest

import symaware_cli as sa
from symaware_cli.language.build import Built
from symaware_cli.language.execution import execute
from symaware_cli.language.json_schema import scenario_schema
from symaware_cli.language.problem import Problem
from symaware_cli.studies.batch_simulation import refusal

pytestmark = pytest.mark.usefixtures("known_sections")


@pytest.fixture
def sailing(sound: dict[str, Any]) -> dict[str, Any]:
    """A scenario with wind."""
    sound["regions"] = {"bay": {"box": [0, 5, 0, 5]}}
    sound["weather"] = {"bay": 4.0}
    sound["agents"]["robot"]["components"]["sail"] = {"use": "sound.sail"}
    return sound


def test_components_find_the_section_and_it_takes_part_in_the_run(
    sailing: dict[str, Any], building: Callable[..., Built]
) -> None:
    built = building(sailing)
    assert built.sections["weather"] == {"bay": 4.0}
    assert [group.sections["weather"] for group in built.simulation.groups] == [{"bay": 4.0}]
    started = import_module("weather_plugins.weather").STARTED
    started.clear()
    execute(built, None)
    assert started == [{"bay": 4.0}]


def test_it_is_in_the_resolved_document(sailing: dict[str, Any], building: Callable[..., Built]) -> None:
    built = building(sailing)
    built.simulation.environment.close()
    assert b"weather:\n  bay: 4.0\n" in built.resolved


@pytest.mark.parametrize(
    ("weather", "code", "path"),
    [
        ({"bay": -1.0}, "out-of-range", "weather.bay"),
        ({"bay": "strong"}, "wrong-type", "weather.bay"),
        ({"gulf": 4.0}, "unknown-target", "weather.gulf"),
        ({}, "unsuitable", "agents.robot.components.sail"),
        ({"bay": 30.0}, "unsuitable", "agents.robot.components.sail"),
    ],
)
def test_problems_are_located(
    weather: Any, code: str, path: str, sailing: dict[str, Any], problems: Callable[..., list[Problem]]
) -> None:
    sailing["weather"] = weather
    (problem,) = problems(sailing)
    assert (problem.code, problem.path) == (code, path)
    assert problem.span is not None


def test_the_key_of_a_section_is_suggested_for_a_similar_one(
    sailing: dict[str, Any], problems: Callable[..., list[Problem]]
) -> None:
    sailing["wether"] = sailing.pop("weather")
    found = [each for each in problems(sailing) if each.code == "unknown-key"]
    assert [(each.path, each.suggestion) for each in found] == [("wether", "weather")]


@pytest.mark.parametrize(
    ("key", "said"),
    [("broken_weather", "no weather today"), ("lost_weather", "has no attribute 'Lost'")],
)
def test_a_section_that_fails_is_reported_at_its_key(
    key: str, said: str, sound: dict[str, Any], problems: Callable[..., list[Problem]]
) -> None:
    sound[key] = {}
    (problem,) = problems(sound)
    assert (problem.code, problem.path) == ("broken-plugin", key)
    assert said in problem.message


def test_a_section_that_fails_does_not_affect_other_scenarios(
    sound: dict[str, Any], building: Callable[..., Built]
) -> None:
    building(sound).simulation.environment.close()


def test_a_plugin_replaces_no_section_of_the_language(sound: dict[str, Any], building: Callable[..., Built]) -> None:
    built = building(sound)
    built.simulation.environment.close()
    assert "run" not in built.sections
    assert built.document.run.duration == 1.0


def test_it_is_in_the_schema() -> None:
    schema, broken = scenario_schema()
    assert schema["$defs"]["Scenario" if "Scenario" in schema["$defs"] else "ScenarioDocument"]
    assert "Speeds of the wind, by the names of regions [m/s]." in json.dumps(schema)
    assert any("lost_weather" in each for each in broken)


def test_its_base_classes_are_public() -> None:
    assert {"ScenarioSection", "SectionContext", "ScenarioView"} <= set(sa.__all__)


def test_bodies_and_regions_that_it_adds_are_those_of_the_scenario(
    sound: dict[str, Any], building: Callable[..., Built]
) -> None:
    sound["weather"] = {"at_north": 4.0}  # built later, wherever it is in the file
    sound["harbour"] = {"north": [0, 9], "south": [0, -9]}
    sound["specifications"] = {"off": {"formula": "always not inside(position, at_north)", "each": "robot"}}
    built = building(sound)
    built.simulation.environment.close()
    assert list(built.simulation.environment.obstacles) == ["north", "south"]
    assert [*built.simulation.groups[0].regions] == ["at_north", "at_south"]
    assert built.files["buoys.txt"] == b"north, south"
    assert b"harbour:\n  north:" in built.resolved
    assert b"at_north: {" not in built.resolved


def test_additions_of_a_section_identify_the_scenario(sound: dict[str, Any], building: Callable[..., Built]) -> None:
    digests = []
    for name in ("north", "south"):
        sound["harbour"] = {name: [0, 9]}
        digests.append(building(sound).digest)
    assert digests[0] != digests[1]


@pytest.mark.parametrize(
    ("harbour", "said"),
    [
        ({"robot": [0, 9]}, "`harbour` adds entities with names that are taken: the group `robot`"),
        ({"rock": [0, 9]}, "`harbour` adds entities with names that are taken: the entity `rock`"),
        ({"bay": [5, 0]}, "there is an agent of robot.0"),
    ],
)
def test_taken_names_and_reports_of_a_section_are_located(
    harbour: Any, said: str, sound: dict[str, Any], problems: Callable[..., list[Problem]]
) -> None:
    sound["environment"]["entities"] = {"rock": {"shape": {"circle": {"radius": 1.0}}, "position": [20, 0]}}
    sound["harbour"] = harbour
    (problem,) = problems(sound)
    assert problem.message.startswith(said)
    assert problem.path.startswith("harbour")
    assert problem.span is not None


def test_a_problem_with_a_body_that_it_adds_is_at_the_section(
    sound: dict[str, Any], problems: Callable[..., list[Problem]]
) -> None:
    sound["harbour"] = {"north": [0, 9]}
    sound["regions"] = {"at_north": {"box": [0, 1]}}
    (problem,) = problems(sound)
    assert "the region `at_north`" in problem.message


def test_runs_with_different_bodies_are_not_batched(sound: dict[str, Any], building: Callable[..., Built]) -> None:
    sound["agents"]["robot"]["components"] = {"sense": {"use": "perception.omniscient"}}
    sound["harbour"] = {"north": [0, 9]}
    assert refusal(building(sound)) is None
    sound["harbour"] = {"drifting": [0, 9]}
    assert refusal(building(sound)) == "the section `harbour` draws other bodies in each run"
