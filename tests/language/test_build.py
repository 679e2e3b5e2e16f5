"""From a document to a simulation that is ready to run."""

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from simulating import untyped

from symaware_cli.language.build import Built, build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import Problem, ScenarioError

Building = Callable[..., Built]
Problems = Callable[..., list[Problem]]

pytestmark = pytest.mark.usefixtures("known_plugins")

WATCH = {"use": "sound.watch", "with": {"range": 2.0, "weights": {"wall": 1.0}}}


def told(problems: list[Problem]) -> list[tuple[str, str]]:
    return [(problem.code, problem.path) for problem in problems]


def mutable(value: object) -> Iterator[object]:
    """Everything inside a value that somebody could change."""
    if isinstance(value, dict | list | np.ndarray):
        yield value
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()
    for each in inner:
        yield from mutable(each)
    if hasattr(value, "model_fields_set"):
        yield from mutable(dict(untyped(value)))


def test_a_scenario_becomes_groups_of_agents_with_their_components(building: Building) -> None:
    built = building()
    (group,) = built.simulation.groups
    assert group.ids == ("robot.0", "robot.1")
    assert [entry.name for entry in built.simulation.entries] == ["sense", "steer"]
    assert built.steps == 10
    assert built.uses == {
        "robot": {"model": "unicycle", "components": {"sense": "perception.self", "steer": "control.go-to-goal"}}
    }
    assert list(built.files) == ["scenario.yaml"]


def test_without_a_count_the_agent_is_called_like_its_group(building: Building, sound: Any) -> None:
    del sound["agents"]["robot"]["count"]
    assert building(sound).simulation.groups[0].ids == ("robot",)
    assert building(sound, count=1).simulation.groups[0].ids == ("robot.0",)


@pytest.mark.parametrize(("duration", "step", "steps"), [(1.0, 0.1, 10), (1.0, 0.3, 4), (0.01, 0.1, 1), (0.3, 0.1, 3)])
def test_the_run_ends_with_the_first_step_that_reaches_the_duration(
    building: Building, sound: Any, duration: float, step: float, steps: int
) -> None:
    sound["run"]["duration"], sound["environment"]["with"]["time_step"] = duration, step
    assert building(sound).steps == steps


def test_two_agents_never_share_a_mutable_parameter_or_knowledge(building: Building) -> None:
    facts = {"a": [1, 2], "b": {"deep": [1, {"x": [2]}]}, "c": {"all": ["text", [1]]}, "d": {"all": [[1], [2, 3]]}}
    built = building(knowledge={"goal": [0, 0], "post": [1, 1], **facts}, components={"watch": WATCH}, count=3)
    (entry,) = built.simulation.entries
    owners = [
        [*mutable(dict(knowledge)), *mutable(untyped(component).kept)]
        for knowledge, component in zip(built.simulation.groups[0].knowledge, entry.components, strict=True)
    ]
    seen = [{id(value) for value in owner} for owner in owners]
    assert all(len(owner) >= 6 for owner in seen)
    assert not seen[0] & seen[1]
    assert not seen[0] & seen[2]
    assert not seen[1] & seen[2]
    arrays = [value for owner in owners for value in owner if isinstance(value, np.ndarray)]
    assert not any(np.shares_memory(one, two) for n, one in enumerate(arrays) for two in arrays[:n])
    untyped(entry.components[0]).kept.gains.append(9.0)
    assert untyped(entry.components[1]).kept.gains == [1.0, 2.0]


def test_a_component_whose_init_does_not_call_its_base_has_its_parameters(building: Building) -> None:
    built = building(knowledge={"goal": [0, 0], "post": [1, 1]}, components={"watch": WATCH})
    components = [untyped(component) for component in built.simulation.entries[0].components]
    assert [component.kept.range for component in components] == [2.0, 2.0]
    assert all(component.parameters is component.kept for component in components)


def test_a_component_without_parameters_is_created_without_any(building: Building) -> None:
    built = building(components={"plain": {"use": "sound.plain"}})
    assert len(built.simulation.entries[0].components) == 2


def test_a_group_component_is_created_once(building: Building) -> None:
    assert len(building(count=50).simulation.entries[0].components) == 1


def test_a_given_seed_takes_precedence_and_is_recorded(building: Building) -> None:
    built = building(seed=99)
    assert built.simulation.seed == built.document.seed == 99
    assert yaml.safe_load(built.resolved)["seed"] == 99


def everything(built: Built) -> dict[str, Any]:
    return {
        "document": built.document.model_dump(),
        "states": [group.initial_state.tolist() for group in built.simulation.groups],
        "knowledge": [[{k: repr(v) for k, v in each.items()} for each in g.knowledge] for g in built.simulation.groups],
        "steps": built.steps,
        "uses": built.uses,
        "obstacles": repr(built.simulation.environment.obstacles),
    }


def test_the_resolved_document_builds_the_same_scenario(tmp_path: Path, sound: Any) -> None:
    robot = sound["agents"]["robot"]
    sound["parameters"] = {"far": 4.0, "word": "${parameters.far} m", "escaped": "$${parameters.far}"}
    robot["state"] = [{"uniform": ["${parameters.far}", 6]}, {"normal": [0, 1]}, 0]
    robot["knowledge"] |= {
        "label": "${parameters.word}",
        "plain": "$${parameters.nothing}",
        "texts": ["1e3", "0o17", "yes", "null", "~", "", "1_000", ".5", "0x1F", "2020-01-01", "<<", "a: b", "#", "-"],
        "numbers": [1e3, 1e-9, 1e-22, 15, -0.0, 9007199254740993],
        "map": {"1e3": 1, "true": 2, "nested": [[1, 2], [3]]},
        "unicode": "zwölf 目標 🙂",
    }
    (tmp_path / "base.yaml").write_text(json.dumps(sound, ensure_ascii=False), encoding="utf-8")
    (tmp_path / "top.toml").write_text('extends = "base.yaml"\nname = "top"\n')
    first = build(tmp_path / "top.toml", ["run.duration=2", "parameters.far=5.5"], seed=3)
    assert list(first.files) == ["top.toml", "base.yaml"]
    (tmp_path / "resolved.yaml").write_bytes(first.resolved)
    second = build(tmp_path / "resolved.yaml")
    assert everything(second) == everything(first)
    assert second.document.agents["robot"].knowledge["plain"] == "${parameters.nothing}"
    (tmp_path / "again.yaml").write_bytes(second.resolved)
    assert build(tmp_path / "again.yaml").resolved == second.resolved


def test_a_file_and_its_resolved_document_run_to_the_same_end(tmp_path: Path, sound: Any) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump(sound))
    first = build(path, ["agents.robot.count=3"])
    path.write_bytes(first.resolved)
    second = build(path)
    ends = []
    for built in (first, second):
        execute(built, None)
        ends.append(built.simulation.environment.state(built.simulation.groups[0]).tolist())
    assert ends[0] == ends[1]


def test_problems_of_every_part_are_reported_in_one_pass(problems: Problems, sound: Any) -> None:
    sound["run"]["duration"] = -1
    sound["environment"]["with"]["time_step"] = 0
    sound["extra"] = 1
    found = problems(
        sound,
        model={"use": "unicycle", "with": {"max_speed": 0}},
        state=[1, 2],
        knowledge={"goal": {"uniform": [1, 0]}},
        components={"a": {"use": "perception.slef"}, "b": {"use": "broken.exits"}, "c": {"use": "sound.watch"}},
    )
    assert set(told(found)) == {
        ("out-of-range", "run.duration"),
        ("out-of-range", "environment.with.time_step"),
        ("unknown-key", "extra"),
        ("out-of-range", "agents.robot.model.with.max_speed"),
        ("wrong-length", "agents.robot.state"),
        ("invalid-value", "agents.robot.knowledge.goal.uniform"),
        ("unknown-plugin", "agents.robot.components.a.use"),
        ("broken-plugin", "agents.robot.components.b.use"),
        ("missing-field", "agents.robot.components.c"),
    }


def test_problems_elsewhere_are_reported_beside_an_unreadable_part(tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(
        "symaware: 1\nname: x y\nrun: {duration: .nan}\nenvironment: {use: kinematic}\nagents: {robot: {}}\n"
    )
    with pytest.raises(ScenarioError) as raised:
        build(path)
    assert told(list(raised.value.problems)) == [
        ("bad-name", "name"),
        ("not-finite", "run.duration"),
        ("missing-field", "agents.robot"),
    ]


def test_an_unresolved_reference_is_not_also_a_value_of_the_wrong_type(problems: Problems, sound: Any) -> None:
    sound["parameters"] = {"a": "${parameters.b}", "b": "${parameters.a}", "c": [1, "${parameters.nothing}"]}
    sound["run"]["duration"] = "${parameters.a}"
    found = problems(sound, state="${parameters.c}")
    assert {problem.code for problem in found} == {"cyclic-parameter", "undefined-parameter"}


def test_of_another_version_of_the_format_only_the_version_is_reported(problems: Problems, sound: Any) -> None:
    sound |= {"symaware": 7, "name": "no name", "unheard_of": 1}
    assert told(problems(sound)) == [("wrong-version", "symaware")]


def test_a_required_parameter_beside_with_is_one_problem(problems: Problems) -> None:
    (problem,) = problems(
        knowledge={"goal": [0, 0], "post": [1, 1]}, components={"watch": {"use": "sound.watch", "range": 2}}
    )
    assert problem.expected == "it under `agents.robot.components.watch.with`"


@pytest.mark.parametrize(
    ("robot", "code", "path", "message"),
    [
        (
            {"components": {"c": {"use": "broken.refuses", "with": {"low": 2}}}},
            "invalid-value",
            "components.c.with",
            r"`broken.refuses` refuses its parameters: low must not lie above high",
        ),
        (
            {"components": {"c": {"use": "broken.crashes"}}},
            "broken-plugin",
            "components.c.use",
            r"`broken.crashes` cannot be made: IndexError: list index out of range \(faulty.py, line \d+\)",
        ),
        (
            {"components": {"c": {"use": "broken.leaves"}}},
            "broken-plugin",
            "components.c.use",
            r"`broken.leaves` cannot be made: SystemExit: 3 \(faulty.py, line \d+\)",
        ),
        (
            {"components": {"c": {"use": "broken.raising-parameters", "with": {"speed": 2}}}},
            "broken-plugin",
            "components.c.with",
            r"the Parameters of `broken.raising-parameters` fail: KeyError: 2.0 \(faulty.py, line \d+\)",
        ),
        (
            {"components": {"c": {"use": "broken.crashing-check"}}},
            "unsuitable",
            "components.c",
            r"`broken.crashing-check` cannot work here: ZeroDivisionError: division by zero \(faulty.py, line \d+\)",
        ),
        (
            {"components": {"c": {"use": "broken.unprintable"}}},
            "broken-plugin",
            "components.c.use",
            r"`broken.unprintable` cannot be made: WordlessError \(faulty.py, line \d+\)",
        ),
        (
            {"components": {"c": {"use": "broken.leaving-check"}}},
            "unsuitable",
            "components.c",
            r"`broken.leaving-check` cannot work here: CancelledError \(faulty.py, line \d+\)",
        ),
        (
            {"components": {"c": {"use": "broken.crashing-quantities"}}},
            "unsuitable",
            "components.c",
            r"`broken.crashing-quantities` cannot work here: ZeroDivisionError: division by zero \(faulty.py, .*\)",
        ),
        (
            {"components": {"c": {"use": "broken.nameless-quantities"}}},
            "unsuitable",
            "components.c",
            r"`broken.nameless-quantities` cannot work here: .* not a list of `Quantity` for each series",
        ),
        (
            {"components": {"c": {"use": "broken.foreseeing"}}},
            "unsuitable",
            "components.c",
            r"`broken.foreseeing` cannot work here: .* names 'future', but the series are intent, uncertainty, risk",
        ),
        (
            {"components": {"c": {"use": "broken.taken"}}},
            "broken-plugin",
            "components.c",
            r"`broken.taken` declares a part `control`, a name that has another meaning",
        ),
        (
            {"components": {"c": {"use": "broken.riskier"}}},
            "unsuitable",
            "components.c",
            r"`broken.riskier` and every agent declare different parts `risk`",
        ),
        (
            {"components": {"c": {"use": "broken.endless"}}},
            "broken-plugin",
            "components.c",
            r"`broken.endless` declares a part `modes`, a vector, without columns",
        ),
        (
            {"components": {"c": {"use": "broken.part-names"}}},
            "broken-plugin",
            "components.c",
            r"the `parts` of `broken.part-names` are not a list of `Part`",
        ),
        (
            {"model": {"use": "broken.stateless"}},
            "broken-plugin",
            "model.use",
            r"the model `broken.stateless` declares no `state` as quantities",
        ),
        (
            {"model": {"use": "broken.position"}},
            "broken-plugin",
            "model.use",
            r"the model `broken.position` places its position or heading outside its state",
        ),
        (
            {"knowledge": {}},
            "missing-knowledge",
            "components.steer",
            r"`control.go-to-goal` needs the knowledge `goal`",
        ),
        (
            {"knowledge": {"goals": [0, 0]}},
            "missing-knowledge",
            "knowledge.goals",
            r"`control.go-to-goal` needs the knowledge `goal`, not `goals`",
        ),
        (
            {"knowledge": {"goal": [1, 2, 3]}},
            "unsuitable",
            "knowledge.goal",
            r"`control.go-to-goal` cannot work with this: .*position of 2 numbers",
        ),
        (
            {"knowledge": {"goal": {"each": [[1, 2], "home"]}}},
            "unsuitable",
            "knowledge.goal",
            r"`control.go-to-goal` cannot work with this: the knowledge `goal` is not made of numbers, .*",
        ),
    ],
)
def test_a_plugin_that_cannot_work_is_reported_at_the_place_to_correct(
    problems: Problems, robot: dict[str, Any], code: str, path: str, message: str
) -> None:
    (problem,) = problems(**robot)
    assert (problem.code, problem.path) == (code, f"agents.robot.{path}")
    assert re.fullmatch(message, problem.message)


@pytest.mark.parametrize("use", ["broken.untimed", "broken.setup"])
def test_an_environment_that_cannot_be_used_is_reported(problems: Problems, sound: Any, use: str) -> None:
    sound["environment"] = {"use": use}
    (problem,) = problems(sound)
    assert problem.message.startswith(f"`{use}` ")


def test_a_run_of_absurdly_many_steps_is_refused(problems: Problems, sound: Any) -> None:
    sound["run"]["duration"], sound["environment"]["with"]["time_step"] = 1e9, 1e-6
    (problem,) = problems(sound)
    assert (problem.code, problem.path) == ("too-long", "run.duration")
