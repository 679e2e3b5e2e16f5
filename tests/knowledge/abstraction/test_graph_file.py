from pathlib import Path

import pytest

from symaware_cli.geometry.region import Region
from symaware_cli.knowledge.abstraction.graph_file import GraphFile
from symaware_cli.knowledge.graph_text import GraphText
from symaware_cli.language.problem import ScenarioError
from symaware_cli.world.plugin import ParameterError

REGIONS = {"hall": Region(box=(0, 4, 0, 3)), "lab": Region(box=(4, 6, 1, 2)), "attic": Region(box=(7, 8, 3, 4))}

YAML = "transitions: {hall: [hall, lab], lab: [hall]}\ninitial: [hall]\nlabels: {work: [lab]}\n"
DOT = 'digraph {\n"hall" [labels=""];\n"lab" [labels="work"];\ninit -> hall;\n'
DOT += "hall -> hall;\nhall -> lab;\nlab -> hall;\n}"


def read(folder: Path, name: str, text: str) -> GraphFile:
    (folder / name).write_text(text)
    model = GraphFile(GraphFile.Parameters.model_validate({"graph": {"file": name}}))
    model.folder, model.open_file = folder, GraphText
    model.prepare(REGIONS)
    return model


def test_yaml_and_dot_say_the_same(tmp_path: Path) -> None:
    one, other = read(tmp_path, "a.yaml", YAML).system, read(tmp_path, "a.dot", DOT).system
    assert one == other
    assert one.successors == ((0, 1), (0,))
    assert one.labels_in(1) == {"lab", "work"}


@pytest.mark.parametrize(
    ("text", "place", "said"),
    [
        ("transitions:\n  hall: [hall, attic]\n  attic: []", (2, 16), "share no side"),
        ("transitions:\n  hall: [hall]\n  cellar: []", (3, 3), "no region `cellar`"),
        ("transitions:\n  hall: [lab]", (2, 10), "the states after `hall`: there is no state `lab`"),
        ("transitions:\n  hall: [hall, hall]", (2, 16), "`hall` is there twice"),
        ("transitions:\n  hall: [hall]\n  hall: []", (3, 3), "the key `hall` is already on line 2"),
        ("transitions:\n\thall: [hall]", (2, 1), "a tab cannot be used for indentation"),
        ("transitions: {hall: hall", (1, 14), "never closed"),
        ("[1, 2]", (1, 1), "`transitions`"),
        ("", None, "`transitions`"),
        ("transitions: {}", (1, 14), "at least one state"),
        ("transitions: {hall: 3}", (1, 21), "the states after `hall`: '3' is no list of states"),
        ("transitions: {hall: hall}", (1, 21), "the states after `hall`: 'hall' is no list of states"),
        ("transitions: {hall: [hall]}\ninitial: hall", (2, 10), "`initial`: 'hall' is no list of states"),
        ("transitions: {hall: [hall]}\ninitial: [lab]", (2, 11), "`initial`: there is no state `lab`"),
        ("transitions: {hall: [hall]}\nlabels: [hall]", (2, 9), "`labels` of a transition system"),
        ("transitions: {hall: [hall]}\nlabels: {work: hall}", (2, 16), "the states with the label `work`"),
        ("transitions: {hall: [hall]}\nedges: []", (2, 8), "has no `edges`"),
        ("x" * 1_100_000, None, "larger than 1 MiB"),
    ],
)
def test_a_yaml_file_that_is_no_model_is_refused_at_its_place(
    tmp_path: Path, text: str, place: tuple[int, int] | None, said: str
) -> None:
    with pytest.raises(ScenarioError) as refused:
        read(tmp_path, "a.yaml", text)
    (problem,) = refused.value.problems
    assert said in problem.message
    assert (problem.span and (problem.span.line, problem.span.column)) == place
    assert problem.span is None or problem.span.file == str(tmp_path / "a.yaml")


@pytest.mark.parametrize(
    ("text", "place", "said"),
    [
        ("digraph {\n hall -> hall\n hall -> attic }", (3, 2), "share no side"),
        ("digraph {\n hall -> cellar\n}", (2, 10), "no region `cellar`"),
        ("digraph {\n hall => lab\n}", (2, 8), "`>` cannot stand here"),
    ],
)
def test_a_graph_that_is_no_model_is_refused_at_its_place(
    tmp_path: Path, text: str, place: tuple[int, int], said: str
) -> None:
    with pytest.raises(ScenarioError) as refused:
        read(tmp_path, "a.dot", text)
    (problem,) = refused.value.problems
    assert said in problem.message
    assert problem.span is not None
    assert (problem.span.line, problem.span.column) == place


def test_a_label_is_not_called_like_a_region(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="`lab` is a region"):
        read(tmp_path, "a.yaml", "transitions: {hall: [hall]}\nlabels: {lab: [hall]}")


def test_aliases_and_a_byte_order_mark_are_read_as_in_scenarios(tmp_path: Path) -> None:
    text = "\ufefftransitions: {hall: &both [hall, lab], lab: *both}"
    assert read(tmp_path, "a.yaml", text).system.successors == ((0, 1), (0, 1))
    assert read(tmp_path, "a.dot", "\ufeff" + DOT).system == read(tmp_path, "b.yaml", YAML).system


def test_names_in_yaml_are_texts(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("transitions: {on: [off, 1.0], off: [on], 1.0: }\ninitial: [off]")
    model = GraphFile(GraphFile.Parameters.model_validate({"graph": {"file": "a.yaml"}, "places": False}))
    model.folder, model.open_file = tmp_path, GraphText
    model.prepare({})
    assert model.system.states == ("on", "off", "1.0")
    assert model.system.successors == ((1, 2), (0,), ())


def test_a_link_that_leads_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "a.yaml").write_text(YAML)
    (inner / "b.yaml").symlink_to(tmp_path / "a.yaml")
    model = GraphFile(GraphFile.Parameters.model_validate({"graph": {"file": "b.yaml"}}))
    model.folder = inner
    with pytest.raises(ParameterError, match="out of the scenario's folder"):
        model.prepare(REGIONS)
