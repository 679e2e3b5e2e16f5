"""Groups that are like a template or another group, with changes."""

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

import symaware_cli
from symaware_cli.language import ScenarioError, open_scenario, scenario_schema
from symaware_cli.language.compose import compose
from symaware_cli.log.digest import digest

HEAD = "symaware: 1\nname: alike\nrun: {duration: 0.2}\nenvironment: {use: kinematic}\n"

TEMPLATES = """\
templates:
  robot:
    entity: {shape: {circle: {radius: 0.3}}}
    model: {use: unicycle, with: {max_speed: 1.0}}
    components:
      sense: {use: perception.self}
      steer: {use: control.go-to-goal, with: {speed: 0.8}}
  fast: {like: robot, components: {steer: {with: {speed: 1.0}}}}
  heavy: {entity: {mass: 5.0}}
agents:
  adam: {like: robot, state: [0, 0, 0], knowledge: {goal: [5, 0]}}
  bob: {like: [fast, heavy], state: [0, 3, 0], knowledge: {goal: [5, 3]}}
  eve: {like: bob, state: [0, 6, 0], components: {sense: null}}
"""

IN_FULL = """\
agents:
  adam:
    entity: {shape: {circle: {radius: 0.3}}}
    model: {use: unicycle, with: {max_speed: 1.0}}
    components: {sense: {use: perception.self}, steer: {use: control.go-to-goal, with: {speed: 0.8}}}
    state: [0, 0, 0]
    knowledge: {goal: [5, 0]}
  bob:
    entity: {shape: {circle: {radius: 0.3}}, mass: 5.0}
    model: {use: unicycle, with: {max_speed: 1.0}}
    components: {sense: {use: perception.self}, steer: {use: control.go-to-goal, with: {speed: 1.0}}}
    state: [0, 3, 0]
    knowledge: {goal: [5, 3]}
  eve:
    entity: {shape: {circle: {radius: 0.3}}, mass: 5.0}
    model: {use: unicycle, with: {max_speed: 1.0}}
    components: {steer: {use: control.go-to-goal, with: {speed: 1.0}}}
    state: [0, 6, 0]
    knowledge: {goal: [5, 3]}
"""


def file(folder: Path, text: str, name: str = "alike.yaml") -> Path:
    path = folder / name
    path.write_text(text if text.startswith(("symaware", "extends")) else HEAD + text)
    return path


def test_a_document_with_templates_is_the_one_written_in_full(tmp_path: Path) -> None:
    alike, full = file(tmp_path, TEMPLATES), file(tmp_path, IN_FULL, "full.yaml")
    assert compose(alike).data == compose(full).data
    assert open_scenario(alike).digest == open_scenario(full).digest
    for path in (alike, full):
        symaware_cli.load(path).run(output=path.with_suffix(".mcap"))
    logs = [symaware_cli.open_log(path.with_suffix(".mcap")) for path in (alike, full)]
    assert digest(logs[0]).differences(digest(logs[1])) == ["scenario/alike.yaml", "scenario/full.yaml"]
    assert b"like:" not in logs[0].attachments["resolved.yaml"]
    assert b"like: robot" in logs[0].attachments["scenario/alike.yaml"]


def test_the_order_of_components_is_that_of_the_template_then_that_of_the_group(tmp_path: Path) -> None:
    text = TEMPLATES.replace("adam: {like: robot,", "adam: {components: {last: {use: perception.self}}, like: robot,")
    assert list(compose(file(tmp_path, text)).data["agents"]["adam"]["components"]) == ["sense", "steer", "last"]


def test_changes_apply_to_templates_groups_and_the_like_of_a_group(tmp_path: Path) -> None:
    path = file(tmp_path, TEMPLATES)

    def speeds(*changes: str) -> list[float]:
        agents = compose(path, changes).data["agents"]
        return [agents[name]["components"]["steer"]["with"]["speed"] for name in ("adam", "bob", "eve")]

    assert speeds() == [0.8, 1.0, 1.0]
    assert speeds("templates.fast.components.steer.with.speed=2") == [0.8, 2, 2]
    assert speeds("agents.bob.components.steer.with.speed=3") == [0.8, 3, 1.0], "of that group alone"
    assert speeds("agents.adam.like=fast") == [1.0, 1.0, 1.0]
    assert speeds("templates.robot.components.steer.with={speed: 4}") == [4, 1.0, 1.0]


def test_a_file_that_extends_another_changes_its_templates(tmp_path: Path) -> None:
    file(tmp_path, TEMPLATES)
    more = "extends: alike.yaml\ntemplates: {robot: {model: {with: {max_speed: 2.0}}}}\nagents: {zoe: {like: adam}}\n"
    data = compose(file(tmp_path, more, "more.yaml")).data
    assert [each["model"]["with"]["max_speed"] for each in data["agents"].values()] == [2.0] * 4
    assert data["agents"]["zoe"]["state"] == [0, 0, 0]


def test_references_and_files_in_templates_are_those_of_the_document(tmp_path: Path) -> None:
    text = TEMPLATES.replace("max_speed: 1.0", "max_speed: '${parameters.most}'") + "parameters: {most: 3.0}\n"
    assert compose(file(tmp_path, text)).data["agents"]["eve"]["model"]["with"] == {"max_speed": 3.0}


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ("speed: 0.8", "sped: 0.8", ["alike.yaml:11:47: unknown key `sped`", "in adam (line 15, like robot), bob"]),
        (
            "unicycle",
            "unicicle",
            ["did you mean `unicycle`?", "in adam (line 15, like robot), bob (line 16"],
        ),
        ("[0, 0, 0]", "[0, 0]", ["alike.yaml:15:30: the state has 2 elements"]),
        ("like: bob", "like: bobb", ["alike.yaml:17:15: no template or group is called `bobb`", "mean `bob`?"]),
        ("like: bob", "like: eve", ["a group cannot be like itself: eve -> eve"]),
        ("  robot:\n", "  robot:\n    like: fast\n", ["a group cannot be like itself: robot -> fast -> robot"]),
        ("like: bob", "like: 3", ["`like` names a template or a group"]),
        ("like: bob", "like: [bob, {}]", ["`like` names a template or a group"]),
        ("  heavy: {entity: {mass: 5.0}}", "  heavy: 3", ["the template `heavy` is no mapping"]),
        ("    model: {use: unicycle, with: {max_speed: 1.0}}\n", "", ["alike.yaml:14:3: the field `model` is missing"]),
    ],
)
def test_a_problem_is_reported_once_with_both_places(tmp_path: Path, before: str, after: str, told: list[str]) -> None:
    path = file(tmp_path, TEMPLATES.replace(before, after, 1))
    with pytest.raises(ScenarioError) as caught:
        symaware_cli.load(path)
    for each in told:
        assert each in str(caught.value)
    if "in adam" in told[-1]:
        assert len(caught.value.problems) == 1
        (problem,) = caught.value.problems
        assert [user.partition(" ")[0] for user in problem.users] == ["adam", "bob", "eve"]


def test_a_changed_value_from_a_template_is_reported_at_the_change(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError) as caught:
        symaware_cli.load(file(tmp_path, TEMPLATES), ["agents.adam.components.steer.with.speed=fast"])
    (problem,) = caught.value.problems
    assert problem.span is not None
    assert problem.span.file.startswith("--set")
    assert problem.users == ()


def test_templates_that_multiply_are_bounded(tmp_path: Path) -> None:
    many = ", ".join(f"k{number}: {number}" for number in range(2000))
    groups = "".join(f"  g{number}: {{like: big}}\n" for number in range(100))
    path = file(tmp_path, f"templates: {{big: {{model: {{use: unicycle}}, knowledge: {{{many}}}}}}}\nagents:\n{groups}")
    with pytest.raises(ScenarioError, match="more than"):
        symaware_cli.load(path)


def test_the_schema_has_templates_and_requires_a_model_only_without_like() -> None:
    schema, _ = scenario_schema(built_in_only=True)
    validator = jsonschema.Draft202012Validator(schema)
    assert validator.is_valid(yaml.safe_load(HEAD + TEMPLATES))
    assert not validator.is_valid(yaml.safe_load(HEAD + TEMPLATES.replace("speed: 0.8", "sped: 0.8")))
    assert validator.is_valid(yaml.safe_load(HEAD + "agents: {a: {like: b}, b: {model: {use: unicycle}}}"))
    assert not validator.is_valid(yaml.safe_load(HEAD + "agents: {a: {}, b: {model: {use: unicycle}}}"))
    assert validator.is_valid(yaml.safe_load("extends: a.yaml\nagents: {a: {state: [0, 0]}}"))
    assert "partial:partial" not in json.dumps(schema)


trees = st.recursive(
    st.none() | st.integers(-9, 9),
    lambda inner: st.dictionaries(st.sampled_from("abc"), inner, max_size=3),
    max_leaves=6,
)


def patched(base: Any, patch: Any) -> Any:
    """RFC 7396, with nulls kept where there is nothing to remove, as `compose` says."""
    if not isinstance(base, dict) or not isinstance(patch, dict):
        return patch
    found = dict(base)
    for key, value in patch.items():
        if key in base and value is None:
            del found[key]
        else:
            found[key] = patched(base[key], value) if key in base else value
    return found


@given(st.lists(st.dictionaries(st.sampled_from("abc"), trees, max_size=3), min_size=1, max_size=4))
def test_templates_are_merged_in_the_order_of_like(tmp_path_factory: pytest.TempPathFactory, layers: list[Any]) -> None:
    folder = tmp_path_factory.mktemp("alike")
    *templates, own = [{"knowledge": each} for each in layers]
    document = {
        **yaml.safe_load(HEAD),
        "templates": {f"t{number}": each for number, each in enumerate(templates)},
        "agents": {"g": {"like": [f"t{number}" for number in range(len(templates))], **own}},
    }
    path = folder / "alike.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    expected: Any = None
    for each in [*templates, own]:
        expected = each if expected is None else patched(expected, each)
    assert compose(path).data["agents"]["g"] == expected
