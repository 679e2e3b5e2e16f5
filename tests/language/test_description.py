"""The description of a plugin by `symaware show`."""

import json

import pytest
from features import without_pybullet
from typer.testing import CliRunner

from symaware_cli.cli.application import application
from symaware_cli.entry_points import PluginError
from symaware_cli.language.catalogue import Catalogue
from symaware_cli.language.description import describe, in_words

pytestmark = pytest.mark.usefixtures("known_plugins")


def test_a_plugin_is_described_with_parameters_units_and_defaults() -> None:
    (description,) = describe("sound.watch")
    assert (description.kind, description.package, description.version) == ("component", "sound-plugins", "2.1")
    told = {each.name: (each.type, each.required, each.default) for each in description.parameters}
    assert told == {
        "range": ("number > 0", True, None),
        "rays": ("whole number >= 1 and <= 360", False, 8),
        "gains": ("list of number", False, [1.0, 2.0]),
        "weights": ("mapping", False, {}),
        "mode": ("near or far or both", False, "both"),
        "quiet": ("true or false", False, False),
        "label": ("text", False, ""),
        "reach": ("number or list of number", False, 1.0),
    }
    assert description.knowledge == {"post": "where to stand, as a position [m]"}
    assert description.text.startswith("A component with parameters")


def test_a_model_is_described_with_its_state_and_control_input() -> None:
    (description,) = describe("unicycle")
    assert description.state == {"x": "m", "y": "m", "heading": "rad"}
    assert description.control_input == {"speed": "m/s", "turn_rate": "rad/s"}


@pytest.mark.skipif(without_pybullet(), reason="PyBullet is not installed here")
def test_every_built_in_plugin_is_described_with_the_meaning_of_each_parameter() -> None:
    catalogue = Catalogue()
    for kind in catalogue.kinds:
        for listing in catalogue.listings(kind):
            if not listing.built_in:
                continue
            (description,) = describe(listing.name, catalogue)
            assert description.text, listing.name
            for parameter in description.parameters:
                assert parameter.description.endswith("."), (listing.name, parameter.name)
            json.dumps(description.to_json())


def test_an_unknown_name_gets_the_nearest_of_all_kinds() -> None:
    with pytest.raises(PluginError) as raised:
        describe("unicicle")
    assert raised.value.suggestion == "unicycle"


def test_show_prints_it_for_people_and_for_tools() -> None:
    runner = CliRunner()
    shown = runner.invoke(application, ["show", "sound.watch"])
    assert shown.exit_code == 0
    assert "  range    number > 0, required\n           How far it sees [m].\n" in shown.stdout
    assert "  quiet    true or false, default false\n" in shown.stdout
    assert "  gains    list of number, default [1.0, 2.0]\n" in shown.stdout
    (content,) = json.loads(runner.invoke(application, ["show", "sound.watch", "--json"]).stdout)
    assert [each["name"] for each in content["parameters"]][:2] == ["range", "rays"]
    refused = runner.invoke(application, ["show", "sound.wacth"])
    assert refused.exit_code == 2
    assert refused.stderr == "symaware: nothing called `sound.wacth` is installed; did you mean `sound.watch`?\n"


@pytest.mark.parametrize(
    ("schema", "words"),
    [
        ({"type": "number", "exclusiveMinimum": 0, "maximum": 2.5}, "number > 0 and <= 2.5"),
        ({"type": "integer"}, "whole number"),
        ({"anyOf": [{"type": "number"}, {"type": "null"}]}, "number or null"),
        ({"enum": ["a", "b"]}, "a or b"),
        ({"const": 3}, "3"),
        ({"type": "array", "items": {"type": "string"}}, "list of text"),
        ({"type": "array"}, "list"),
        ({"$ref": "#/$defs/Thing"}, "mapping"),
        ({}, "anything"),
    ],
)
def test_a_schema_is_put_into_words(schema: dict[str, object], words: str) -> None:
    assert in_words(schema, {"Thing": {"type": "object"}}) == words
