"""The JSON schema that editors use."""

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from checkout import CHECKOUT
from features import without_pybullet

from symaware_cli.language.catalogue import Catalogue
from symaware_cli.language.json_schema import scenario_schema
from symaware_cli.language.source_parser import load
from symaware_cli.language.template import template

ROOT = CHECKOUT
BAD = ROOT / "tests" / "scenarios" / "bad"
EXAMPLES = sorted(
    path
    for path in (ROOT / "scenarios").rglob("*")
    if path.suffix in (".yaml", ".toml") and "symaware" in path.read_text(encoding="utf-8")
)

pytestmark = pytest.mark.usefixtures("known_plugins")


@pytest.fixture(scope="module")
def validator(known_plugins: None) -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(scenario_schema()[0])


def document(path: Path) -> dict[str, Any]:
    return load(path, path.name).data


def test_the_schema_is_a_schema(validator: jsonschema.Draft202012Validator) -> None:
    jsonschema.Draft202012Validator.check_schema(validator.schema)
    assert validator.schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_every_example_fits_the_schema(validator: jsonschema.Draft202012Validator, path: Path) -> None:
    validator.validate(document(path))


def test_scenarios_of_new_fit_the_schema(validator: jsonschema.Draft202012Validator, tmp_path: Path) -> None:
    for suffix in ("yaml", "toml"):
        path = tmp_path / f"fresh.{suffix}"
        path.write_text(template("fresh", toml=suffix == "toml"))
        validator.validate(document(path))


@pytest.mark.parametrize(
    "name",
    [
        "absurd-count.yaml",
        "agents-as-a-list.toml",
        "body-without-shape.yaml",
        "components-as-a-list.yaml",
        "count-of-zero.toml",
        "distribution-with-a-seed.yaml",
        "duration-of-zero.yaml",
        "empty-value.yaml",
        "faults-in-a-circle.yaml",
        "faults-in-several-parameters.yaml",
        "flag-for-a-number.yaml",
        "fraction-for-a-count.yaml",
        "group-with-a-space.toml",
        "key-in-the-wrong-place.yaml",
        "missing-field.yaml",
        "missing-parameter.yaml",
        "missing-use.toml",
        "name-with-a-space.yaml",
        "negative-step.yaml",
        "parameter-beside-with.toml",
        "parameter-of-the-wrong-type.yaml",
        "plugin-of-another-kind.yaml",
        "shape-with-two-kinds.yaml",
        "text-for-a-flag.yaml",
        "text-for-a-mapping.toml",
        "text-for-a-number.toml",
        "two-distributions.yaml",
        "uniform-of-three.yaml",
        "unknown-choice.yaml",
        "unknown-component.yaml",
        "unknown-environment.yaml",
        "unknown-key-at-the-top.toml",
        "unknown-key-of-a-group.yaml",
        "unknown-model.toml",
        "unknown-parameter.toml",
        "with-is-a-list.yaml",
        "wrong-version.yaml",
    ],
)
def test_the_schema_rejects_values_that_validate_refuses(validator: jsonschema.Draft202012Validator, name: str) -> None:
    assert list(validator.iter_errors(document(BAD / name))), name


def test_references_may_replace_numbers_and_flags(validator: jsonschema.Draft202012Validator, sound: Any) -> None:
    sound["run"]["duration"] = "${parameters.duration}"
    sound["agents"]["robot"] |= {
        "count": "${parameters.count}",
        "entity": {"shape": {"circle": {"radius": "${parameters.radius}"}}},
        "model": {"use": "unicycle", "with": {"max_speed": "${parameters.speed}"}},
        "state": {"circle": {"radius": "${parameters.far}"}},
        "components": {
            "watch": {"use": "sound.watch", "with": {"range": "${parameters.r}", "quiet": "${parameters.q}"}}
        },
    }
    validator.validate(sound)


def test_a_file_that_extends_another_may_leave_anything_out(validator: jsonschema.Draft202012Validator) -> None:
    changes = {"robot": {"count": 3, "model": {"with": {"max_speed": 2.0}}, "knowledge": None}, "other": None}
    validator.validate({"extends": "base.yaml", "agents": changes, "recording": None})
    assert list(validator.iter_errors({"extends": "base.yaml", "agents": {"robot": {"cuont": 3}}}))
    assert list(validator.iter_errors({"extends": "base.yaml", "agents": {"robot": {"count": 0}}}))
    assert list(validator.iter_errors({"agents": {"robot": {"count": 3}}}))


def test_the_schema_has_the_parameters_of_every_plugin_that_can_be_loaded() -> None:
    schema, broken = scenario_schema()
    catalogue = Catalogue()
    catalogue.add_sections()
    # Sections and faults are keys of the document, so their names are not in a definition of their own.
    kinds = catalogue.kinds.keys() - {"fault", "section"}
    names = {f"{kind}:{listing.name}" for kind in kinds for listing in catalogue.listings(kind)}
    described = {name for name in schema["$defs"] if name.count(":") == 1 and not name.startswith("partial:")}
    assert "component:sound.watch" in described
    assert {"component:broken.exits", "component:twin.watch"} <= names - described
    assert len(broken) >= len(names - described)
    watch = schema["$defs"]["component:sound.watch"]["properties"]
    assert watch["range"]["description"] == "How far it sees [m]."


@pytest.mark.skipif(without_pybullet(), reason="PyBullet is not installed here")
def test_the_built_in_schema_has_no_other_plugins() -> None:
    schema, broken = scenario_schema(built_in_only=True)
    assert broken == []
    assert "sound." not in json.dumps(schema)
    assert "component:perception.self" in schema["$defs"]


@pytest.mark.skipif(without_pybullet(), reason="PyBullet is not installed here")
def test_the_schema_in_the_repository_is_fresh() -> None:
    written = (ROOT / "schemas" / "scenario.schema.json").read_text(encoding="utf-8")
    fresh = json.dumps(scenario_schema(built_in_only=True)[0], indent=2, ensure_ascii=False) + "\n"
    assert written == fresh, "run: symaware schema --built-in -o schemas/scenario.schema.json"


def test_every_reference_in_the_schema_can_be_resolved(validator: jsonschema.Draft202012Validator) -> None:
    def references(node: Any) -> list[str]:
        if isinstance(node, dict):
            own = [node["$ref"]] if isinstance(node.get("$ref"), str) else []
            return own + [each for value in node.values() for each in references(value)]
        return [each for value in node for each in references(value)] if isinstance(node, list) else []

    for reference in references(validator.schema):
        assert reference.removeprefix("#/$defs/") in validator.schema["$defs"], reference


def test_every_setting_has_a_description_that_an_editor_can_show() -> None:
    schema, _ = scenario_schema(built_in_only=True)
    for name, definition in schema["$defs"].items():
        for key, entry in definition.get("properties", {}).items() if not name.startswith("partial:") else ():
            assert entry.get("description") or "$ref" in entry, (name, key)
