"""Every plugin may check the whole scenario; its reports are located at its section, or at a given place."""

import re
from collections.abc import Callable
from typing import Any

import pytest
from checkout import CHECKOUT

from symaware_cli.language.build import Built
from symaware_cli.language.problem import Problem

pytestmark = pytest.mark.usefixtures("known_plugins")

#: The plugins, by the path of their sections.
SECTIONS = {
    "agents.robot.components.need": "needy.component",
    "agents.other.model": "needy.model",
    "environment": "needy.world",
    "topology": "needy.links",
    "knowledge_models.map": "needy.cells",
}


def with_needs(sound: dict[str, Any], section: str, given: dict[str, Any]) -> dict[str, Any]:
    """The sound scenario with a plugin that needs a component."""
    place = sound
    *above, last = section.split(".")
    sound["agents"]["other"] = {"model": {"use": "single-integrator"}, "state": [1.0, 1.0]}
    sound["knowledge_models"] = {}
    if section == "agents.other.model":
        sound["agents"]["other"]["state"] = [1.0]
    for key in above:
        place = place[key]
    if section == "environment":
        given = {"time_step": 0.1, **given}
    if section == "knowledge_models.map":
        sound["regions"] = {"floor": {"box": [0, 2, 0, 1]}}
        given = {"cell": 1.0, "region": "floor", **given}
    place[last] = {"use": SECTIONS[section], "with": given}
    return sound


@pytest.mark.parametrize("section", SECTIONS)
def test_a_plugin_of_any_kind_accepts_a_suitable_scenario(
    section: str, sound: dict[str, Any], building: Callable[..., Built]
) -> None:
    building(with_needs(sound, section, {"needs": "robot.steer"})).simulation.environment.close()


@pytest.mark.parametrize("section", SECTIONS)
@pytest.mark.parametrize(
    ("told", "place", "code", "said"),
    [
        ("report", ".with.needs", "unsuitable", "there is no `robot.stear`, but 10 steps"),
        ("unknown", ".with.needs", "unknown-target", "there is no component `robot.stear`"),
        ("raise", "", "unsuitable", "there is no `robot.stear`"),
        ("fail", "", "broken-plugin", "cannot check the scenario: RuntimeError: oh (checks.py, line"),
    ],
)
def test_a_plugin_of_any_kind_refuses_a_scenario_at_a_place(
    section: str,
    told: str,
    place: str,
    code: str,
    said: str,
    sound: dict[str, Any],
    problems: Callable[..., list[Problem]],
) -> None:
    (problem,) = problems(with_needs(sound, section, {"needs": "robot.stear", "told": told}))
    assert problem.path == section + (".use" if told == "fail" else place)
    assert problem.code == code
    assert said in problem.message
    assert problem.span is not None
    if told == "unknown":
        assert problem.suggestion == "robot.steer"


@pytest.mark.parametrize("section", SECTIONS)
def test_a_plugin_of_any_kind_warns(section: str, sound: dict[str, Any], building: Callable[..., Built]) -> None:
    built = building(with_needs(sound, section, {"told": "warn"}))
    with built.simulation.environment:
        found = [each for each in built.find_warnings() if each.path == f"{section}.with.told"]
    assert [each.message for each in found] == ["of 2 groups none is lucky"]


def test_it_is_checked_together_with_other_problems(
    sound: dict[str, Any], problems: Callable[..., list[Problem]]
) -> None:
    scenario = with_needs(sound, "agents.robot.components.need", {"needs": "nobody.nothing"})
    scenario["specifications"] = {"safe": {"each": "robot", "formula": "always altitude < 3"}}
    assert {each.path.partition(".")[0] for each in problems(scenario)} == {"agents", "specifications"}


def test_a_missing_parameter_is_located_at_the_section(
    sound: dict[str, Any], problems: Callable[..., list[Problem]]
) -> None:
    scenario = with_needs(sound, "agents.robot.components.need", {"told": "report"})
    scenario["agents"]["robot"]["components"]["go"] = scenario["agents"]["robot"]["components"].pop("steer")
    (problem,) = problems(scenario)
    assert problem.path == "agents.robot.components.need"


def test_the_language_names_no_component() -> None:
    """Only common checks of sensors; a check of a single component is in its own module."""
    folder = CHECKOUT / "symaware_cli" / "scenario"
    found = {
        name
        for path in folder.glob("*.py")
        for name in re.findall(r"from symaware_cli\.components\.(\S+) import", path.read_text())
    }
    assert found <= {"sensor"}
