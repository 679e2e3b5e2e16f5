"""The valid content of scenarios."""

import copy
import json
import re
from typing import Any

import pytest
from pydantic import BaseModel, ValidationError
from simulating import untyped

from symaware_cli.language.document import GroupSection, ScenarioDocument, document_of
from symaware_cli.language.placement import CirclePlacement, GridPlacement
from symaware_cli.language.scenario_section import ScenarioSection
from symaware_cli.language.section import Section

LEAST = {
    "symaware": 1,
    "name": "least",
    "run": {"duration": 1},
    "environment": {"use": "kinematic"},
    "agents": {"robot": {"model": {"use": "unicycle"}}},
}


def sections() -> list[type[BaseModel]]:
    # Imports those that few scenarios have.
    document_of({}, (), {})
    return subclasses(Section)


def subclasses(model: type[BaseModel]) -> list[type[BaseModel]]:
    return [each for kind in model.__subclasses__() for each in (kind, *subclasses(kind))]


def read(**changes: object) -> ScenarioDocument:
    return ScenarioDocument.model_validate_json(json.dumps(LEAST | changes), strict=True)


def test_the_least_scenario_has_five_fields() -> None:
    scenario = read()
    assert (scenario.seed, scenario.run.mode, scenario.recording.interval) == (0, "synchronous", 0.0)
    assert scenario.agents["robot"].count is None
    assert scenario.agents["robot"].entity.radius == 0.0
    for name in LEAST:
        with pytest.raises(ValidationError):
            ScenarioDocument.model_validate_json(
                json.dumps({key: value for key, value in LEAST.items() if key != name})
            )


def test_every_field_has_a_description_and_every_quantity_a_unit() -> None:
    quantities = {"duration", "interval", "spacing", "origin", "radius", "centre", "phase"}
    for section in {*sections(), GridPlacement, CirclePlacement}:
        for name, field in untyped(section).model_fields.items():
            assert field.description, (section, name)
            assert field.description.endswith("."), (section, name)
            if name in quantities and field.annotation is not bool:
                assert re.search(r"\[[a-z/^2]+\]", field.description), (section, name)


def test_no_section_takes_keys_that_are_not_described_or_can_be_changed() -> None:
    for section in sections():
        assert section.model_config["extra"] == "forbid"
        assert section.model_config["frozen"] is True


@pytest.mark.parametrize("name", ["a", "_", "robot-1", "Robot_2", "x" * 64])
def test_valid_names(name: str) -> None:
    assert read(name=name).name == name


@pytest.mark.parametrize("name", ["", "1st", "-a", "a.b", "a b", "a/b", "a\n", "é", "x" * 65, "../a", "a$"])
def test_invalid_names(name: str) -> None:
    with pytest.raises(ValidationError):
        read(name=name)
    with pytest.raises(ValidationError):
        read(agents={name: LEAST["agents"]["robot"]})  # type: ignore[index]


@pytest.mark.parametrize("count", [1, 100_000])
def test_a_group_has_one_to_a_hundred_thousand_agents(count: int) -> None:
    group = GroupSection.model_validate_json(json.dumps({"count": count, "model": {"use": "unicycle"}}), strict=True)
    assert group.count == count
    for wrong in (0, -1, 100_001, 1.5, True, "2"):
        with pytest.raises(ValidationError):
            GroupSection.model_validate_json(json.dumps({"count": wrong, "model": {"use": "unicycle"}}), strict=True)


WHOLE = {
    **LEAST,
    "environment": {
        "use": "kinematic",
        "entities": {"wall": {"shape": {"circle": {"radius": 1.0}}, "position": [2.0, 0.0]}},
    },
    "agents": {
        "robot": {
            "model": {"use": "unicycle"},
            "present": {"from": 1.0},
            "components": {"a": {"use": "x", "latency": {"uniform": [0.0, 1.0]}}, "b": {"use": "y"}},
        }
    },
    "topology": {"use": "ring", "channel": {"loss": 0.5}},
    "regions": {"yard": {"circle": {"centre": [0.0, 0.0], "radius": 1.0}}},
    "specifications": {"safe": {"formula": "always nearest > 0"}},
    "subscribers": {"one": {"use": "print"}},
}


def without(data: Any, *path: str) -> Any:
    """A copy without what is at a path."""
    first, *rest = path
    if not rest:
        return {key: value for key, value in data.items() if key != first}
    return {**data, first: without(data[first], *rest)}


PARTS: list[tuple[str, ...]] = [
    ("topology",),
    ("regions",),
    ("specifications",),
    ("environment", "entities"),
    ("agents", "robot", "present"),
    ("agents", "robot", "components", "a", "latency"),
]


@pytest.mark.parametrize("left_out", [(), *PARTS], ids=lambda path: ".".join(path) or "nothing")
def test_a_document_is_the_same_by_the_model_of_its_own_fields(left_out: tuple[str, ...]) -> None:
    data = without(WHOLE, *left_out) if left_out else WHOLE
    text = json.dumps(data)
    own, whole = (document_of({}, (), {}, each).model_validate_json(text, strict=True) for each in (data, None))
    assert own.model_dump() == whole.model_dump()


class Sole(ScenarioSection):
    """A section that is a number."""

    form = int
    description = "A number."


class Named(Sole):
    """A section with named numbers."""

    form = dict[str, int]


@pytest.mark.parametrize("given", [{}, {"sole": 1}, {"named": {"a": 1}}], ids=str)
def test_sections_of_plugins_that_a_document_does_not_have_have_their_defaults(given: dict[str, object]) -> None:
    data, kinds = {**LEAST, **given}, {"sole": Sole, "named": Named, "unknown": None}
    text = json.dumps(data)
    own, whole = (document_of({}, (), kinds, each).model_validate_json(text, strict=True) for each in (data, None))
    assert own.model_dump() == whole.model_dump()
    assert {name: getattr(own, name) for name in kinds} == {"sole": None, "named": {}, "unknown": None} | given


@pytest.mark.parametrize("given", PARTS, ids=".".join)
@pytest.mark.parametrize("value", [[1], "nonsense", {"nonsense": 1}], ids=str)
def test_a_wrong_value_of_a_field_that_few_scenarios_have_is_refused(given: tuple[str, ...], value: object) -> None:
    data = copy.deepcopy(WHOLE)
    place: Any = data
    for key in given[:-1]:
        place = place[key]
    place[given[-1]] = value
    with pytest.raises(ValidationError):
        document_of({}, (), {}, data).model_validate_json(json.dumps(data), strict=True)


@pytest.mark.parametrize("data", [{}, {"agents": 1}, {"agents": {"a": 2}}, {"agents": {"a": {"components": [3]}}}])
def test_the_model_of_a_malformed_document_is_made(data: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        document_of({}, (), {}, data).model_validate_json(json.dumps(data), strict=True)
