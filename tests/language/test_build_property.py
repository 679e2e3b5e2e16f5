"""Building any document succeeds or reports problems that all have a place."""

import copy
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from symaware_cli.language.build import Built, build
from symaware_cli.language.problem import ScenarioError, render, to_json
from symaware_cli.world import MODIFIERS, RANDOM

pytestmark = pytest.mark.usefixtures("known_plugins")

SOUND: dict[str, Any] = {
    "symaware": 1,
    "name": "property",
    "description": "A scenario with everything in it.",
    "seed": 5,
    "parameters": {"speed": 1.0, "goals": [[1, 0], [0, 1], [1, 1]], "deep": {"er": "${parameters.speed}"}},
    "run": {"mode": "synchronous", "duration": 1.0},
    "environment": {
        "use": "kinematic",
        "with": {"time_step": 0.1, "integrator": "rk4"},
        "entities": {"wall": {"shape": {"circle": {"radius": 1.0}}, "position": [3.0, 4.0], "mass": 2.0}},
    },
    "agents": {
        "robot": {
            "count": 3,
            "entity": {"shape": {"circle": {"radius": 0.3}}, "mass": 5.0},
            "model": {"use": "unicycle", "with": {"max_speed": "${parameters.speed}"}},
            "state": [{"uniform": [-1, 1]}, {"normal": [0, 2.5]}, 0],
            "knowledge": {
                "goal": "${parameters.goals}",
                "post": {"grid": {"spacing": [1, 2]}},
                "fact": {"all": ["a", 1]},
            },
            "components": {
                "sense": {"use": "perception.self"},
                "watch": {
                    "use": "sound.watch",
                    "with": {"range": 2, "gains": [1, 2], "weights": {"wall": 1}, "mode": "far"},
                },
                "steer": {"use": "control.go-to-goal", "with": {"speed": 0.5}},
            },
        },
        "lone": {"model": {"use": "single-integrator"}, "state": {"circle": {"radius": 2.0, "heading": "along"}}},
    },
    "recording": {"interval": 0.5, "omit": ["risk"]},
}

NAMES = [
    *("symaware", "use", "with", "count", "model", "state", "goal", "all", "each", "uniform", "normal", "grid"),
    *(
        "circle",
        "radius",
        "heading",
        "x",
        "a b",
        "a.b",
        "",
        "1",
        "knowledge",
        "components",
        "extends",
        "parameters",
        "ä",
    ),
]
PLUGINS = [
    *("perception.self", "perception.omniscient", "control.go-to-goal", "unicycle", "single-integrator", "kinematic"),
    *("sound.watch", "sound.band", "sound.plain", "sound.line", "twin.watch", "nobody", "", "broken.exits"),
    *("broken.raises", "broken.abstract", "broken.refuses", "broken.crashes", "broken.stateless", "broken.position"),
    *("broken.untimed", "broken.setup", "broken.crashing-check", "broken.bad-parameters", "broken.raising-parameters"),
]
TEXTS = ["", "3", "1e3", "true", "north", "${parameters.speed}", "${parameters.goals}", "${parameters.nothing}", "${"]
NUMBERS = [0, 1, 2, 3, -1, 100_001, 2**63 - 1, -(2**63), 2**64, 0.0, -0.5, 1e-9, 1e308, -1e308, 5e-324]
SCALARS = st.sampled_from([None, True, False, *NUMBERS, *TEXTS, *PLUGINS]) | st.floats(-1e6, 1e6)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(NAMES), inner, max_size=3),
    max_leaves=6,
)
DISTRIBUTIONS = st.dictionaries(
    st.sampled_from([*RANDOM, *MODIFIERS, "grid", "circle", "each", "all", "unifrom"]), VALUES, min_size=1, max_size=2
)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield from places(inner, (*path, key))


PLACES = [path for path in places(SOUND) if path]


@st.composite
def documents(draw: st.DrawFn) -> dict[str, Any]:
    """The sound document with a few values replaced, removed, renamed or added."""
    document = copy.deepcopy(SOUND)
    for _ in range(draw(st.integers(0, 4))):
        path = draw(st.sampled_from(PLACES))
        parent: Any = document
        try:
            for part in path[:-1]:
                parent = parent[part]
            parent[path[-1]]
        except (KeyError, IndexError, TypeError):
            continue
        last = path[-1]
        match draw(st.integers(0, 5)):
            case 0:
                del parent[last]
            case 1 if isinstance(parent, dict):
                parent[draw(st.sampled_from(NAMES))] = parent.pop(last)
            case 2 if isinstance(parent, dict):
                parent[draw(st.sampled_from(NAMES))] = draw(VALUES)
            case 3:
                parent[last] = draw(DISTRIBUTIONS)
            case _:
                parent[last] = draw(VALUES)
    return document


def outcome(path: Path) -> Built | ScenarioError:
    try:
        return build(path, name="property.yaml")
    except ScenarioError as error:
        return error


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(document=documents())
def test_a_document_is_built_or_refused_with_places(tmp_path: Path, document: dict[str, Any]) -> None:
    path = tmp_path / "property.yaml"
    path.write_text(json.dumps(document, indent=1), encoding="utf-8")
    result = outcome(path)
    if isinstance(result, ScenarioError):
        assert result.problems
        lines = path.read_text(encoding="utf-8").split("\n")
        for problem in result.problems:
            # Only what `extends` names can be a problem of the file itself.
            assert problem.span is not None, problem
            assert problem.source_line == lines[problem.span.line - 1]
            assert 1 <= problem.span.column < problem.span.end_column
            assert re.fullmatch(r"[a-z0-9-]+", problem.code)
            assert problem.message.isprintable()
        assert "Traceback" not in render(result.problems)
        assert json.dumps(to_json(result.problems))
        return
    assert all(group.initial_state.shape[1] == len(group.model.state) for group in result.simulation.groups)
    path.write_bytes(result.resolved)
    again = outcome(path)
    assert isinstance(again, Built), again
    assert again.document == result.document
    for one, other in zip(result.simulation.groups, again.simulation.groups, strict=True):
        assert one.initial_state.tolist() == other.initial_state.tolist()
        assert repr(one.knowledge) == repr(other.knowledge)


def test_the_document_that_is_changed_is_sound(tmp_path: Path) -> None:
    path = tmp_path / "property.yaml"
    path.write_text(json.dumps(SOUND))
    assert isinstance(outcome(path), Built)
