"""`extends`, `--set` and `parameters`."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.language.compose import Composition, CompositionError, compose
from symaware_cli.language.merge_patch import merge
from symaware_cli.language.problem import Problem, ScenarioError, TextSpan
from symaware_cli.language.source import MappingEntry, SourceNode


class Folder:
    """A folder of scenario files that the user sees as `scenarios/`."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def write(self, **files: str) -> None:
        for name, text in files.items():
            path = self.path / name.replace("__", "/").replace("_", ".")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)

    def compose(self, *overrides: str, top: str = "top.yaml") -> Composition:
        return compose(self.path / top, overrides, f"scenarios/{top}")

    def data(self, *overrides: str, top: str = "top.yaml") -> dict[str, Any]:
        return self.compose(*overrides, top=top).data

    def problems(self, *overrides: str, top: str = "top.yaml") -> tuple[Problem, ...]:
        with pytest.raises(ScenarioError) as caught:
            self.compose(*overrides, top=top)
        return caught.value.problems

    def only(self, *overrides: str, top: str = "top.yaml") -> Problem:
        (problem,) = self.problems(*overrides, top=top)
        return problem


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    (tmp_path / "scenarios").mkdir()
    return Folder(tmp_path / "scenarios")


def marked(composition: Composition, *path: str | int, key: bool = False) -> str:
    span = composition.span(path, key)
    assert span is not None
    line = composition.line_text(span)
    assert line is not None
    return f"{span.file}:{span.line}: {line[span.column - 1 : span.end_column - 1]}"


# extends


def test_a_file_wins_over_its_bases_and_a_later_base_over_an_earlier(folder: Folder) -> None:
    folder.write(
        a_yaml="{x: 1, y: 1, z: 1, m: {p: 1, q: 1}}",
        b_toml="y = 2\nz = 2\nm = {q = 2, r = 2}",
        top_yaml="extends: [a.yaml, b.toml]\nz: 3\nm: {r: 3}\n",
    )
    composition = folder.compose()
    assert composition.data == {"x": 1, "y": 2, "z": 3, "m": {"p": 1, "q": 2, "r": 3}}
    assert marked(composition, "x") == "scenarios/a.yaml:1: 1"
    assert marked(composition, "m", "q") == "scenarios/b.toml:3: 2"
    assert marked(composition, "m", "r") == "scenarios/top.yaml:3: 3"
    assert marked(composition, "z", key=True) == "scenarios/top.yaml:2: z"


def test_toml_may_extend_yaml(folder: Folder) -> None:
    folder.write(a_yaml="x: 1", top_toml="extends = 'a.yaml'\ny = 2")
    assert folder.data(top="top.toml") == {"x": 1, "y": 2}


def test_lists_are_replaced_and_null_removes_inherited_keys(folder: Folder) -> None:
    folder.write(
        a_yaml="{x: [1, 2], y: {z: 1, w: 1}, v: 1}",
        top_yaml="extends: a.yaml\nx: [3]\ny: {z: null}\nn: null\nv: {u: null}",
    )
    assert folder.data() == {"x": [3], "y": {"w": 1}, "n": None, "v": {"u": None}}


def test_inherited_keys_keep_their_order_and_new_ones_follow(folder: Folder) -> None:
    folder.write(a_yaml="components: {a: 1, b: 2, c: 3}", top_yaml="extends: a.yaml\ncomponents: {d: 4, b: 5}")
    assert list(folder.data()["components"]) == ["a", "b", "c", "d"]


def test_files_are_kept_as_written_with_the_top_first(folder: Folder) -> None:
    folder.write(top_yaml="extends: parts/a.yaml\n# top", parts__a_yaml="extends: ../b.toml\n", b_toml="x = 1\r\n")
    assert list(folder.compose().files.items()) == [
        ("top.yaml", b"extends: parts/a.yaml\n# top"),
        ("parts/a.yaml", b"extends: ../b.toml\n"),
        ("b.toml", b"x = 1\r\n"),
    ]


def test_a_missing_base_is_located_where_it_is_named(folder: Folder) -> None:
    folder.write(base_yaml="x: 1", top_yaml="a: 1\nextends: [base.yaml, bse.yaml]")
    problem = folder.only()
    assert (problem.code, problem.suggestion, problem.path) == ("missing-file", "base.yaml", "extends[1]")
    assert problem.span == TextSpan("scenarios/top.yaml", 2, 22, 30)
    assert problem.source_line == "extends: [base.yaml, bse.yaml]"


@pytest.mark.parametrize(
    "name", ["../out.yaml", "/etc/out.yaml", "a/../../out.yaml", "link.yaml", "C:\\out.yaml", "down/out.yaml"]
)
def test_a_base_outside_the_folder_is_refused(folder: Folder, name: str) -> None:
    (folder.path.parent / "out.yaml").write_text("x: 1")
    (folder.path / "link.yaml").symlink_to("../out.yaml")
    (folder.path / "down").symlink_to("..")
    folder.write(top_yaml=f"extends: '{name}'")
    assert folder.only().code == "outside-folder"


def test_a_symbolic_link_within_the_folder_is_fine(folder: Folder) -> None:
    folder.write(a_yaml="x: 1", top_yaml="extends: link.yaml")
    (folder.path / "link.yaml").symlink_to("a.yaml")
    assert folder.data() == {"x": 1}


def test_a_cycle_is_named(folder: Folder) -> None:
    folder.write(top_yaml="extends: a.yaml", a_yaml="extends: b.toml", b_toml="extends = 'a.yaml'")
    problem = folder.only()
    assert (problem.code, problem.message) == (
        "cyclic-extends",
        "a file cannot extend itself: a.yaml -> b.toml -> a.yaml",
    )
    assert problem.span is not None
    assert problem.span.file == "scenarios/b.toml"


def test_depth_and_number_of_bases_have_a_bound(folder: Folder) -> None:
    for index in range(40):
        (folder.path / f"d{index}.yaml").write_text(f"extends: [d{index + 1}.yaml, d{index + 1}.yaml]")
        (folder.path / f"w{index}.yaml").write_text(
            f"extends: [{', '.join(f'w{i}.yaml' for i in range(index + 1, 16))}]"
        )
    folder.write(top_yaml="extends: d0.yaml", wide_yaml="extends: w0.yaml")
    assert {problem.code for problem in folder.problems()} == {"too-deep"}
    assert {problem.code for problem in folder.problems(top="wide.yaml")} == {"too-deep"}


@pytest.mark.parametrize("value", ["3", "{a: b}", "''", "null", "[a.yaml, 3]"])
def test_extends_names_files(folder: Folder, value: str) -> None:
    folder.write(top_yaml=f"extends: {value}", a_yaml="x: 1")
    assert folder.only().code == "wrong-type"


def test_problems_of_all_files_are_reported_together(folder: Folder) -> None:
    folder.write(top_yaml="extends: [a.yaml, b.toml]\nx: .nan", a_yaml="x: !foo 1\n", b_toml="a = 1\na = 2")
    assert [(problem.span.file, problem.code) for problem in folder.problems() if problem.span] == [
        ("scenarios/a.yaml", "tag-not-allowed"),
        ("scenarios/b.toml", "duplicate-key"),
        ("scenarios/top.yaml", "not-finite"),
    ]


_DATA = st.recursive(
    st.none() | st.integers(0, 3),
    lambda inner: st.dictionaries(st.sampled_from("abcd"), inner, max_size=4),
    max_leaves=12,
)
_SPAN = TextSpan("f", 1, 1, 2)


def _node(value: Any) -> SourceNode:
    if isinstance(value, dict):
        return SourceNode({key: MappingEntry(_SPAN, _node(item)) for key, item in value.items()}, _SPAN)
    return SourceNode(value, _SPAN)


def _merge_patch(target: Any, patch: Any) -> Any:
    """RFC 7396, section 2, but for the one rule that a null stays where nothing is inherited."""
    if not isinstance(patch, dict):
        return patch
    if not isinstance(target, dict):
        return patch
    result = dict(target)
    for key, value in patch.items():
        if value is None and key in result:
            del result[key]
        else:
            result[key] = _merge_patch(result.get(key), value)
    return result


@given(_DATA, _DATA)
def test_merging_is_a_json_merge_patch(base: Any, overlay: Any) -> None:
    assert merge(_node(base), _node(overlay)).plain() == _merge_patch(base, overlay)


# --set

ROBOT = """\
name: hello
parameters: {speed: 1.5}
agents:
  robot:
    count: 4
    goal: [[1, 2], [3, 4]]
    components:
      steer: {use: go, with: {speed: 1}}
      plain:
        use: sit
        with:
"""


@pytest.mark.parametrize(
    ("override", "path", "value"),
    [
        ("agents.robot.count=0", ("agents", "robot", "count"), 0),
        ("agents.robot.count=1e3", ("agents", "robot", "count"), 1000.0),
        ("agents.robot.count={uniform: [0, 1]}", ("agents", "robot", "count"), {"uniform": [0, 1]}),
        ("agents.robot.mass=", ("agents", "robot", "mass"), None),
        ("agents.robot.count=true", ("agents", "robot", "count"), True),
        ("agents.robot.count=a=b", ("agents", "robot", "count"), "a=b"),
        ("agents.robot.count='1'", ("agents", "robot", "count"), "1"),
        ("agents.robot.goal[1][0]=9", ("agents", "robot", "goal", 1, 0), 9),
        ("agents.robot.goal[1]=[7]", ("agents", "robot", "goal", 1), [7]),
        ("agents.robot.components.steer.with.speed=2", ("agents", "robot", "components", "steer", "with", "speed"), 2),
        (
            "agents.robot.components.steer.lock.period=2",
            ("agents", "robot", "components", "steer", "lock", "period"),
            2,
        ),
        ("agents.robot.components.plain.with.speed=2", ("agents", "robot", "components", "plain", "with", "speed"), 2),
        ("agents.robot.components.new={use: x}", ("agents", "robot", "components", "new"), {"use": "x"}),
        ("run.duration=3", ("run", "duration"), 3),
    ],
)
def test_an_override_sets_a_value_and_is_its_place(
    folder: Folder, override: str, path: tuple[str | int, ...], value: object
) -> None:
    folder.write(top_yaml=ROBOT)
    composition = folder.compose(override)
    data: Any = composition.data
    for part in path:
        data = data[part]
    assert data == value
    assert type(data) is type(value)
    span = composition.span(path)
    assert span is not None
    assert (span.file, span.line) == (f"--set {override}", 1)
    assert span.column == override.index("=") + 2
    assert composition.line_text(span) == override


def test_the_rest_of_the_document_stays_and_later_overrides_win(folder: Folder) -> None:
    folder.write(top_yaml=ROBOT)
    before = folder.data()
    after = folder.data("agents.robot.goal[0][1]=5", "agents.robot.goal[0][1]=6")
    before["agents"]["robot"]["goal"][0][1] = 6
    assert after == before


def _mappings(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the path of each key of nested mappings."""
    for key, inner in value.items() if isinstance(value, dict) else ():
        yield (*path, key)
        yield from _mappings(inner, (*path, key))


def test_null_removes_a_key_as_it_does_in_a_file_that_extends(folder: Folder) -> None:
    folder.write(base_yaml=ROBOT)
    paths = list(_mappings(folder.data(top="base.yaml")))
    assert len(paths) > 10
    for path in paths:
        patch: Any = None
        for part in reversed(path):
            patch = {part: patch}
        folder.write(top_yaml=f"{{extends: base.yaml, {json.dumps(patch)[1:-1]}}}")
        expected = folder.data()
        for null in ("null", ""):
            assert folder.data(f"{'.'.join(path)}={null}", top="base.yaml") == expected, path
    # Where there is nothing to remove it is a value like any other.
    assert folder.data("agents.robot.mass=null", top="base.yaml")["agents"]["robot"]["mass"] is None
    assert folder.data("agents.robot.goal[1]=null", top="base.yaml")["agents"]["robot"]["goal"] == [[1, 2], None]


def test_a_place_inside_an_override_is_counted_in_its_text(folder: Folder) -> None:
    folder.write(top_yaml=ROBOT)
    composition = folder.compose("agents.robot.goal={uniform: [0, x]}")
    assert marked(composition, "agents", "robot", "goal", "uniform", 1).endswith(": x")
    assert marked(composition, "agents", "robot", "goal", key=True).endswith(": goal")


@pytest.mark.parametrize(
    ("override", "code", "column", "suggestion"),
    [
        ("agents.rboot.count=0", "bad-set-path", 8, "robot"),
        ("agents.robot.components.ster.with.speed=2", "bad-set-path", 25, "steer"),
        ("environment.entities.wall.mass=2", "bad-set-path", 22, None),
        ("agents.robot.count.x=2", "bad-set-path", 20, None),
        ("agents.robot.goal[2]=2", "bad-set-path", 18, None),
        ("agents.robot.goal.1=2", "bad-set-path", 19, None),
        ("agents.robot.goal[x]=2", "bad-set-path", 18, None),
        ("agents.robot.goal[-1]=2", "bad-set-path", 18, None),
        ("agents.robot.goal[0=2", "bad-set-path", 18, None),
        ("agents.robot[1].count=2", "bad-set-path", 17, None),
        ("agents.robot.1.state=2", "bad-set-path", 14, None),
        ("run[0]=2", "bad-set-path", 4, None),
        ("agents.robot.goal.-1=2", "bad-set-path", 19, None),
        ("agents.robot.goal.x=2", "bad-set-path", 19, None),
        ("agents.robot.goal.٠=2", "bad-set-path", 19, None),
        ("agents..count=2", "bad-set-path", 8, None),
        ("agents.=2", "bad-set-path", 8, None),
        ("=2", "bad-set-path", 1, None),
        ("a\nb=2", "bad-set-path", 1, None),
        ("extends=a.yaml", "bad-set-path", 1, None),
        ("agents.robot.count", "bad-set", 1, None),
        ("name=[1", "unclosed", 6, None),
        ("name=!foo 1", "tag-not-allowed", 6, None),
        ("name=.nan", "not-finite", 6, None),
        ("name=\x1b", "bad-character", 6, None),
        ("name=a\udcffb", "not-utf-8", 7, None),
        (".".join("a" * 33) + "=1", "too-deep", 1, None),
        ("a.b.c=" + "[" * 31 + "]" * 31, "too-deep", None, None),
    ],
)
def test_a_bad_override_is_located_in_its_text(
    folder: Folder, override: str, code: str, column: int | None, suggestion: str | None
) -> None:
    folder.write(top_yaml=ROBOT)
    problem = folder.only(override)
    assert (problem.code, problem.suggestion) == (code, suggestion)
    if column is not None:
        assert problem.span is not None
        assert problem.span.file.startswith("--set ")
        assert problem.span.column == column


def test_all_bad_overrides_are_reported_together(folder: Folder) -> None:
    folder.write(top_yaml=ROBOT)
    assert len(folder.problems("agents.rboot.count=1", "name.x=1", "x=${foo}")) == 3
    assert len(folder.problems("a", "b", "c=[")) == 3


# parameters


def test_a_reference_takes_the_type_and_the_place_of_its_parameter(folder: Folder) -> None:
    folder.write(
        top_yaml="parameters: {n: 3, goals: [[1, 2]], deep: {er: true}}\n"
        "a: ${parameters.n}\nb: [ '${parameters.goals}' ]\nc: ${ parameters.deep.er }\nd: ${parameters.deep}\n"
    )
    composition = folder.compose()
    assert composition.data == {
        "parameters": {"n": 3, "goals": [[1, 2]], "deep": {"er": True}},
        "a": 3,
        "b": [[[1, 2]]],
        "c": True,
        "d": {"er": True},
    }
    assert marked(composition, "a") == "scenarios/top.yaml:1: 3"
    assert marked(composition, "a", key=True) == "scenarios/top.yaml:2: a"
    assert marked(composition, "b", 0, 0, 1) == "scenarios/top.yaml:1: 2"


def test_a_reference_inside_a_text_is_formatted_into_it(folder: Folder) -> None:
    folder.write(
        top_yaml="parameters: {n: 3, f: 0.5, t: true, s: x}\n"
        "a: n${parameters.n}-${parameters.f}-${parameters.t}-${parameters.s}\n"
    )
    composition = folder.compose()
    assert composition.data["a"] == "n3-0.5-true-x"
    assert marked(composition, "a").startswith("scenarios/top.yaml:2: n${")


def test_two_dollars_are_a_plain_brace(folder: Folder) -> None:
    folder.write(top_yaml="parameters: {n: 3}\na: $${parameters.n} ${parameters.n} $$ $5 {}\n")
    assert folder.data()["a"] == "${parameters.n} 3 $$ $5 {}"


def test_parameters_may_refer_to_each_other(folder: Folder) -> None:
    folder.write(
        top_yaml="parameters: {a: '${parameters.b}', b: ['${parameters.c.d}'], c: {d: 1, e: '${parameters.c.d}'}}"
    )
    assert folder.data()["parameters"] == {"a": [1], "b": [1], "c": {"d": 1, "e": 1}}


def test_an_override_comes_before_the_references(folder: Folder) -> None:
    folder.write(top_yaml="parameters: {n: 3, m: 4}\na: ${parameters.n}\n")
    composition = folder.compose("parameters.n=${parameters.m}", "parameters.m=5")
    assert composition.data["a"] == 5
    assert marked(composition, "a") == "--set parameters.m=5:1: 5"


def test_an_inherited_reference_sees_the_parameters_of_the_heir(folder: Folder) -> None:
    folder.write(a_yaml="parameters: {n: 1}\na: ${parameters.n}", top_yaml="extends: a.yaml\nparameters: {n: 2}")
    assert folder.data()["a"] == 2


@pytest.mark.parametrize(
    ("text", "code", "suggestion"),
    [
        ("${parameters.sped}", "undefined-parameter", "speed"),
        ("${parameters.deep.innr}", "undefined-parameter", "deep.inner"),
        ("${parameters.speed.x}", "undefined-parameter", None),
        ("${speed}", "bad-reference", None),
        ("${parameters}", "bad-reference", None),
        ("${parameters.}", "bad-reference", None),
        ("${env:HOME}", "bad-reference", None),
        ("${}", "bad-reference", None),
        ("${parameters.speed", "bad-reference", None),
        ("${${parameters.speed}}", "bad-reference", None),
        ("a ${parameters.deep}", "bad-reference", None),
        ("a ${parameters.list}", "bad-reference", None),
        ("a ${parameters.nothing}", "bad-reference", None),
    ],
)
def test_a_reference_that_cannot_be_replaced_is_located(
    folder: Folder, text: str, code: str, suggestion: str | None
) -> None:
    parameters = "parameters: {speed: 1, deep: {inner: 2}, list: [1], nothing: null}"
    folder.write(top_yaml=f"{parameters}\nagents: [1, '{text}']\n")
    problem = folder.only()
    assert (problem.code, problem.suggestion, problem.path) == (code, suggestion, "agents[1]")
    assert problem.span is not None
    assert (problem.span.line, problem.span.column) == (2, 13)


def test_a_cycle_of_parameters_is_reported_once(folder: Folder) -> None:
    folder.write(top_yaml="parameters: {a: '${parameters.b}', b: 'x${parameters.a}'}\nc: ${parameters.a}")
    problem = folder.only()
    assert (problem.code, problem.message) == ("cyclic-parameter", "a parameter cannot refer to itself: a -> b -> a")


def test_parameters_are_a_mapping(folder: Folder) -> None:
    folder.write(top_yaml="parameters: [1]\na: 1")
    assert folder.only().code == "wrong-type"
    folder.write(top_yaml="parameters:\na: 1")
    assert folder.data() == {"parameters": None, "a": 1}


def _laughs(line: str, count: int) -> str:
    return "parameters:\n  p0: xxxxxxxxxx\n" + "".join(
        line.format(this=index + 1, last=f"${{parameters.p{index}}}") for index in range(count)
    )


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (_laughs("  p{this}: '{last}{last}'\n", 60), "too-large"),
        (_laughs("  p{this}: ['{last}', '{last}']\n", 30), "too-large"),
        (_laughs("  p{this}: ['{last}']\n", 60), "too-deep"),
        (
            "parameters:\n" + "".join(f"  p{i}: '${{parameters.p{i + 1}}}'\n" for i in range(5000)) + "  p5000: 1",
            "too-deep",
        ),
        ("parameters: {p: " + "x" * 500_000 + "}\na: [" + "'${parameters.p}'," * 20_000 + "]", "too-large"),
    ],
)
def test_expanded_parameters_have_a_bound(folder: Folder, text: str, code: str) -> None:
    folder.write(top_yaml=text)
    started = time.process_time()
    assert {problem.code for problem in folder.problems()} == {code}
    assert time.process_time() - started < 60  # or it grows faster than the text


# what a Composition tells


def test_the_place_of_a_missing_value_is_its_nearest_ancestor(folder: Folder) -> None:
    folder.write(top_yaml="agents:\n  robot: {count: 1}\n")
    composition = folder.compose()
    assert marked(composition, "agents", "robot", "model", "use") == "scenarios/top.yaml:2: {count: 1}"
    assert marked(composition, "agents", "robot", "model", key=True) == "scenarios/top.yaml:2: robot"
    assert marked(composition, "nothing") == "scenarios/top.yaml:1: a"


def test_a_problem_is_filled_in(folder: Folder) -> None:
    folder.write(top_yaml="agents:\n  robot: {count: 1}\n")
    problem = folder.compose().problem(
        "x", "wrong", ("agents", "robot", "count"), key=True, expected="e", suggestion="s"
    )
    assert problem == Problem(
        "x", "wrong", TextSpan("scenarios/top.yaml", 2, 11, 16), "agents.robot.count", "e", "s", "  robot: {count: 1}"
    )


def test_a_document_with_single_bad_values_can_still_be_checked_further(folder: Folder) -> None:
    folder.write(top_yaml="a: .nan\nb: 1\nb: 2\nc: ${parameters.x}\n")
    with pytest.raises(CompositionError) as caught:
        folder.compose()
    assert len(caught.value.problems) == 3
    assert caught.value.partial.data == {"a": None, "b": 1, "c": "${parameters.x}"}


def test_a_document_with_a_part_missing_is_not_checked_further(folder: Folder) -> None:
    folder.write(broken_yaml="a: [", top_yaml="extends: broken.yaml\nb: .nan")
    with pytest.raises(ScenarioError) as caught:
        folder.compose()
    assert not isinstance(caught.value, CompositionError)


def test_without_a_name_a_file_is_called_by_its_path(folder: Folder) -> None:
    folder.write(top_yaml="extends: a.yaml", a_yaml="x: 1")
    span = compose(folder.path / "top.yaml").span(("x",))
    assert span is not None
    assert span.file == str(folder.path / "a.yaml")


def test_a_scenario_that_is_not_there_suggests_its_neighbour(folder: Folder) -> None:
    folder.write(hello_yaml="x: 1")
    problem = folder.only(top="helo.yaml")
    assert (problem.code, problem.suggestion, problem.span) == ("missing-file", "hello.yaml", None)


def test_a_parser_is_imported_only_when_its_format_is_read(folder: Folder) -> None:
    folder.write(top_yaml="x: 1", top_toml="x = 1")
    code = (
        "import sys, pathlib\n"
        "from symaware_cli.language.compose import compose\n"
        "compose(pathlib.Path(sys.argv[1]))\n"
        "print(*(name for name in ('yaml', 'tomllib') if name in sys.modules))"
    )
    for name, parser in (("top.yaml", "yaml"), ("top.toml", "tomllib")):
        command = [sys.executable, "-c", code, str(folder.path / name)]
        assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.split() == [parser]
