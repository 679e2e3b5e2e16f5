"""YAML files as data with positions."""

import time
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from symaware_cli.language.problem import Problem, ScenarioError
from symaware_cli.language.source import MAX_DEPTH, MAX_NODES, Source
from symaware_cli.language.source_parser import load


def read(tmp_path: Path, text: str | bytes) -> Source:
    path = tmp_path / "f.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load(path, "f.yaml")


def problems(tmp_path: Path, text: str | bytes) -> tuple[Problem, ...]:
    with pytest.raises(ScenarioError) as caught:
        read(tmp_path, text)
    return caught.value.problems


def only(tmp_path: Path, text: str | bytes) -> tuple[str, int, int]:
    (problem,) = problems(tmp_path, text)
    assert problem.span is not None
    return problem.code, problem.span.line, problem.span.column


def marked(source: Source, path: tuple[str | int, ...], key: bool = False) -> str:
    span = source.span(path, key)
    assert span is not None
    line = source.line_text(span.line)
    assert line is not None
    return line[span.column - 1 : span.end_column - 1]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None),
        ("~", None),
        ("null", None),
        ("true", True),
        ("False", False),
        ("on", "on"),
        ("yes", "yes"),
        ("No", "No"),
        ("1e3", 1000.0),
        (".5", 0.5),
        ("5.", 5.0),
        ("-3", -3),
        ("+3", 3),
        ("012", 12),
        ("0o17", 15),
        ("0x1F", 31),
        ("1:30", "1:30"),
        ("2001-01-01", "2001-01-01"),
        ("1_000", "1_000"),
        ("'1'", "1"),
        ('"true"', "true"),
        ("9223372036854775807", 2**63 - 1),
        ("-9223372036854775808", -(2**63)),
        ("!!str 1", "1"),
        ("!!int '1'", 1),
        ("!!float 1", 1.0),
        ("!!null ''", None),
        ("!!bool true", True),
        ("!!map {}", {}),
        ("!!seq []", []),
        ("|\n  x\n  y", "x\ny"),
        ("١", "١"),
    ],
)
def test_scalars_follow_the_core_schema_of_yaml_1_2(tmp_path: Path, text: str, value: object) -> None:
    data = read(tmp_path, f"a: {text}").data["a"]
    assert data == value
    assert type(data) is type(value)


def test_every_key_and_value_has_its_place(tmp_path: Path) -> None:
    source = read(tmp_path, "a:\n  bé: [1, 'x y', {z: 2.5}]\n  c: |\n    text\n# end\nd:\n")
    assert marked(source, ("a",), key=True) == "a"
    assert marked(source, ("a",)) == "b"
    assert marked(source, ("a", "bé")) == "[1, 'x y', {z: 2.5}]"
    assert marked(source, ("a", "bé", 1)) == "'x y'"
    assert marked(source, ("a", "bé", 2)) == "{z: 2.5}"
    assert marked(source, ("a", "bé", 2, "z"), key=True) == "z"
    assert marked(source, ("a", "bé", 2, "z")) == "2.5"
    assert marked(source, ("a", "c")) == "|"
    assert source.span(("a", "nothing")) is None
    empty = source.span(("d",))
    assert empty is not None
    assert (empty.line, empty.column) == (6, 3)


def test_line_breaks_of_every_system_count_alike(tmp_path: Path) -> None:
    for line_break in ("\n", "\r\n", "\r"):
        source = read(tmp_path, line_break.join(["a: 1", "b: 2", "c: 3"]))
        span = source.span(("c",))
        assert span is not None
        assert (span.line, span.column) == (3, 4)


def test_a_duplicate_key_names_the_line_of_the_first(tmp_path: Path) -> None:
    (problem,) = problems(tmp_path, "a: 1\nb:\n  c: 1\n  d: 2\n  c: 3\n")
    assert problem.code == "duplicate-key"
    assert problem.message == "the key `c` is already on line 3"
    assert problem.path == "b.c"
    assert problem.span is not None
    assert (problem.span.line, problem.span.column) == (5, 3)


def test_everything_wrong_with_single_values_is_reported_in_one_pass(tmp_path: Path) -> None:
    text = "a: !!python/object/apply:os.system [x]\nb: !foo 3\nc: .nan\nd: -.INF\na: 1e999\n"
    text += "e: 99999999999999999999\n1.5: x\n"
    assert [problem.code for problem in problems(tmp_path, text)] == [
        "tag-not-allowed",
        "tag-not-allowed",
        "not-finite",
        "not-finite",
        "duplicate-key",
        "not-finite",
        "too-large-number",
        "key-not-text",
    ]


def test_a_tag_is_marked_itself(tmp_path: Path) -> None:
    (problem,) = problems(tmp_path, "a: &x !!python/name:os.system x")
    assert problem.span is not None
    assert (problem.span.column, problem.span.end_column) == (7, 30)
    assert problem.path == "a"


@pytest.mark.parametrize("text", ["a: !!bool yes", "a: !!int x", "a: !!seq {}", "a: !!map 1", "a: !!str []"])
def test_a_core_tag_on_another_kind_of_value_is_refused(tmp_path: Path, text: str) -> None:
    assert only(tmp_path, text) == ("wrong-tag", 1, 4)


@pytest.mark.parametrize("digits", ["9" * 5000, "-" + "9" * 30, "0x" + "f" * 9000, "0o" + "7" * 50])
def test_a_number_of_any_length_is_refused_and_not_converted(tmp_path: Path, digits: str) -> None:
    assert only(tmp_path, f"a: {digits}") == ("too-large-number", 1, 4)


@pytest.mark.parametrize("key", ["01", "0x1", "+1", "true", "null", "1.5", "~"])
def test_a_key_that_is_no_text_is_reported_with_its_correction(tmp_path: Path, key: str) -> None:
    (problem,) = problems(tmp_path, f"a: 1\n{key}: 2\n")
    assert problem.code == "key-not-text"
    assert problem.expected == f'"{key}"'


def test_the_number_of_an_agent_is_a_key_with_or_without_quotes(tmp_path: Path) -> None:
    assert read(tmp_path, 'a: {2: x, "3": y, -1: z}').data == {"a": {"2": "x", "3": "y", "-1": "z"}}
    assert only(tmp_path, 'a: {2: x, "2": y}')[0] == "duplicate-key"


@pytest.mark.parametrize("text", ["[a]: 1", "{a: 1}: 1", "? [a]\n: 1"])
def test_a_list_or_mapping_cannot_be_a_key(tmp_path: Path, text: str) -> None:
    assert only(tmp_path, text)[0] == "key-not-text"


def test_an_alias_is_its_value_at_the_place_of_the_alias(tmp_path: Path) -> None:
    source = read(tmp_path, "a: &x {b: 1}\nc: *x\n")
    assert source.data == {"a": {"b": 1}, "c": {"b": 1}}
    assert source.data["a"] is not source.data["c"]
    assert marked(source, ("c",)) == "*x"
    span = source.span(("c", "b"))
    assert span is not None
    assert span.line == 1


def test_explicit_keys_and_earlier_mappings_take_precedence_over_merge_keys(tmp_path: Path) -> None:
    source = read(tmp_path, "a: &a {x: 1, y: 2}\nb: {y: 3, <<: *a}\nc: {<<: [*a, {x: 9, z: 4}]}\n'<<': 1\n")
    assert source.data["b"] == {"x": 1, "y": 3}
    assert source.data["c"] == {"x": 1, "y": 2, "z": 4}
    assert source.data["<<"] == 1
    assert only(tmp_path, "a: {<<: 3}") == ("bad-merge", 1, 9)
    assert only(tmp_path, "a: {<<: [{}, 3]}") == ("bad-merge", 1, 14)


def test_an_undefined_or_recursive_alias_is_a_problem(tmp_path: Path) -> None:
    (problem,) = problems(tmp_path, "a: &speed 1\nb: *sped\n")
    assert (problem.code, problem.suggestion) == ("undefined-alias", "speed")
    assert only(tmp_path, "a: &a [*a]") == ("cyclic-alias", 1, 8)


def test_an_alias_bomb_is_stopped_quickly(tmp_path: Path) -> None:
    text = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n"
    text += "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 20))
    started = time.process_time()
    assert only(tmp_path, text)[0] == "too-large"
    assert time.process_time() - started < 60  # expanded, it has 9^20 nodes


def test_a_long_text_repeated_by_aliases_counts_as_many_values(tmp_path: Path) -> None:
    text = f"a: &a {'x' * 500_000}\nb: [{', '.join(['*a'] * 20_000)}]\n"
    assert only(tmp_path, text)[0] == "too-large"


def test_nesting_has_a_bound(tmp_path: Path) -> None:
    read(tmp_path, "a: " + "[" * (MAX_DEPTH - 1) + "1" + "]" * (MAX_DEPTH - 1))
    assert only(tmp_path, "a: " + "[" * MAX_DEPTH + "]" * MAX_DEPTH) == ("too-deep", 1, 3 + MAX_DEPTH)
    assert only(tmp_path, "- " * 1000)[0] == "too-deep"
    assert only(tmp_path, "[" * 500_000)[0] == "too-deep"
    assert only(tmp_path, "? " * 100_000)[0] == "too-deep"
    deep = "a: &a " + "[" * 20 + "]" * 20 + "\nb: " + "[" * 15 + "*a" + "]" * 15
    assert only(tmp_path, deep)[0] == "too-deep"


def test_the_number_of_values_has_a_bound(tmp_path: Path) -> None:
    read(tmp_path, "a: [" + "1," * (MAX_NODES // 2) + "]")
    assert only(tmp_path, "a: [" + "1," * (MAX_NODES + 1) + "]")[0] == "too-large"


@pytest.mark.parametrize(
    ("text", "code", "line", "column"),
    [
        ("", "empty", 1, 1),
        ("# only a comment\n", "empty", 1, 1),
        ("---\n", "empty", 1, 1),
        ("- a\n- b\n", "not-a-mapping", 1, 1),
        ("text\n", "not-a-mapping", 1, 1),
        ("a: 1\n---\nb: 2\n", "several-documents", 2, 1),
        ("a:\n\tb: 1\n", "tab", 2, 1),
        ("a:\n    b: 1\n  c: 2\n", "bad-indentation", 3, 3),
        ("a: 1\n  b: 2\n", "bad-indentation", 2, 3),
        ("a: [1, 2\n", "unclosed", 1, 4),
        ("a: [1, 2\nb: 3\n", "unclosed", 1, 4),
        ("a: {b: 1\n", "unclosed", 1, 4),
        ("a: 'x\n", "unclosed", 1, 4),
        ('a: "x\nb: 1\n', "unclosed", 1, 4),
        ("a: [1 2]: 3", "syntax", 1, 9),
        ("a: [b}", "syntax", 1, 6),
        ("a: b: c\n", "syntax", 1, 5),
        ("a: 1\nfoo\nb: 2\n", "syntax", 2, 1),
        ("a: @x\n", "syntax", 1, 4),
        ("- a\nb: 1\n", "syntax", 2, 1),
        ("a: 'x' y\n", "syntax", 1, 8),
        ('a: "\\q"\n', "bad-escape", 1, 5),
        ('a: "\\ud800"\n', "bad-escape", 1, 7),
        ('a: "\\0"\n', "bad-character", 1, 4),
        ("a: 1\nb: \x07\n", "bad-character", 2, 4),
        ("a: \u2028", "bad-character", 1, 4),
        ("a: {b: ${parameters.c}}", "syntax", 1, 9),
    ],
)
def test_problems_are_located_where_a_person_corrects_them(
    tmp_path: Path, text: str, code: str, line: int, column: int
) -> None:
    assert only(tmp_path, text) == (code, line, column)


def test_no_message_uses_the_words_of_the_parser(tmp_path: Path) -> None:
    for text in (
        "a: [",
        "a:\n\tb: 1",
        "a: b: c",
        "- a\nb: 1",
        "a: &",
        "%X\n---\na: 1",
        "a: |x",
        "a: ]",
        "*a : &",
        "!<",
    ):
        for problem in problems(tmp_path, text):
            assert not any(word in problem.message for word in ("token", "scanning", "node", "did not find"))


def test_bytes_that_are_not_utf_8_are_located(tmp_path: Path) -> None:
    (problem,) = problems(tmp_path, "a: 1\né: ".encode() + b"\xff\n")
    assert problem.code == "not-utf-8"
    assert "0xff at offset 9" in problem.message
    assert problem.span is not None
    assert (problem.span.line, problem.span.column) == (2, 4)


def test_a_byte_order_mark_is_accepted(tmp_path: Path) -> None:
    source = read(tmp_path, b"\xef\xbb\xbfa: 1\n")
    assert source.data == {"a": 1}
    assert source.raw.startswith(b"\xef\xbb\xbf")
    assert marked(source, ("a",), key=True) == "a"
    assert problems(tmp_path, b"\xef\xbb\xbf\xff")[0].code == "not-utf-8"


def test_an_unreadable_file_is_reported_with_the_reason(tmp_path: Path) -> None:
    def code(path: Path) -> str:
        with pytest.raises(ScenarioError) as caught:
            load(path, "name")
        return caught.value.problems[0].code

    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "text.txt").write_text("a: 1")
    (tmp_path / "big.yaml").write_bytes(b"#" * (1024 * 1024 + 1))
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    assert code(tmp_path / "nothing.yaml") == "missing-file"
    assert code(tmp_path / "folder.yaml") == "not-a-file"
    assert code(tmp_path / "text.txt") == "unknown-format"
    assert code(tmp_path / "big.yaml") == "too-large"
    assert code(tmp_path / "loop.yaml") == "unreadable"
    assert code(tmp_path / ("x" * 5000 + ".yaml")) == "unreadable"
    assert code(Path("/dev/zero")) == "not-a-file"


def test_a_missing_file_suggests_its_neighbour(tmp_path: Path) -> None:
    (tmp_path / "hello.yaml").write_text("a: 1")
    with pytest.raises(ScenarioError) as caught:
        load(tmp_path / "helo.yaml", "helo.yaml")
    assert caught.value.problems[0].suggestion == "hello.yaml"


def test_parsing_stops_after_a_hundred_problems(tmp_path: Path) -> None:
    assert len(problems(tmp_path, "".join(f"a: {i}\n" for i in range(10_000)))) <= 100


# Characters that a YAML file may hold as they are; others are refused, which is another test.
_TEXT = st.text(
    st.characters(codec="utf-8", exclude_categories=["Cc", "Cs", "Zl", "Zp", "Cn"], exclude_characters="\ufeff")
)
_SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
    | _TEXT
)
_VALUES = st.recursive(
    _SCALARS, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(_TEXT, inner, max_size=4), max_leaves=15
)


class _CoreDumper(yaml.SafeDumper):
    """Writes YAML 1.2: texts that only YAML 1.1 reads as numbers or dates need no quotes, unlike those of 1.2."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _quote(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    plain = text.isascii() and text.isalpha() and text.lower() not in ("true", "false", "null")
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=None if plain else '"')


_CoreDumper.add_representer(str, _quote)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    data=st.dictionaries(_TEXT, _VALUES, min_size=1, max_size=5),
    flow=st.sampled_from([True, False, None]),
    indent=st.integers(2, 6),
    unicode=st.booleans(),
    line_break=st.sampled_from(["\n", "\r\n", "\r"]),
)
def test_written_values_are_read_back_with_their_places(
    tmp_path: Path, data: dict[str, Any], flow: bool | None, indent: int, unicode: bool, line_break: str
) -> None:
    text = yaml.dump(
        data,
        Dumper=_CoreDumper,
        default_flow_style=flow,
        indent=indent,
        allow_unicode=unicode,
        sort_keys=False,
        width=10_000_000,
        line_break=line_break,
    )
    path = tmp_path / "f.yaml"
    path.write_bytes(text.encode())
    source = load(path, "f.yaml")
    assert source.data == data
    assert repr(source.data) == repr(data)
    _check_places(source, data, ())


def _check_places(source: Source, value: Any, path: tuple[str | int, ...]) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            shown = marked(source, (*path, key), key=True)
            assert yaml.safe_load(shown.removeprefix("? ")) == key or shown == key
            _check_places(source, item, (*path, key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            _check_places(source, item, (*path, index))
    elif isinstance(value, str):
        assert yaml.safe_load(marked(source, path)) == value or marked(source, path) == value
    elif isinstance(value, bool | int):
        assert yaml.safe_load(marked(source, path)) == value
    elif isinstance(value, float):
        assert float(marked(source, path)) == value


def test_the_parser_without_c_reads_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "a:\n  bé: &x [1, 'x y', {z: 2.5}]\n  c: |\n    text\n  <<: {d: 1}\ne: *x\nf: !!str 1\ng:\n"
    with_c = read(tmp_path, text)
    monkeypatch.setattr("symaware_cli.language.yaml_source._LOADER", yaml.SafeLoader)
    without = read(tmp_path, text)
    assert without.data == with_c.data
    for path in [("a", "bé"), ("a", "bé", 2, "z"), ("a", "c"), ("a", "d"), ("e",), ("e", 1), ("f",), ("g",)]:
        assert without.span(path, key=True) == with_c.span(path, key=True)
        assert marked(without, path) == marked(with_c, path)
    assert only(tmp_path, "a: [1, 2\n") == ("unclosed", 1, 4)
    assert only(tmp_path, "a:\n\tb: 1\n") == ("tab", 2, 1)
    assert only(tmp_path, "a: [" + "1," * 200 + "[" * 100)[0] == "too-deep"
