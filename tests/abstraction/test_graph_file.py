from pathlib import Path

import pytest

from symaware_cli.abstraction.graph_file import GraphFile
from symaware_cli.geometry.region import Region
from symaware_cli.world.plugin import ParameterError

REGIONS = {"hall": Region(box=(0, 4, 0, 3)), "lab": Region(box=(4, 6, 1, 2)), "attic": Region(box=(7, 8, 3, 4))}

YAML = "transitions: {hall: [hall, lab], lab: [hall]}\ninitial: [hall]\nlabels: {work: [lab]}\n"
DOT = 'digraph {\n"hall" [labels=""];\n"lab" [labels="work"];\ninit -> hall;\n'
DOT += "hall -> hall;\nhall -> lab;\nlab -> hall;\n}"


def read(folder: Path, name: str, text: str) -> GraphFile:
    (folder / name).write_text(text)
    model = GraphFile(GraphFile.Parameters.model_validate({"graph": {"file": name}}))
    model.folder = folder
    model.prepare(REGIONS)
    return model


def test_yaml_and_dot_say_the_same(tmp_path: Path) -> None:
    one, other = read(tmp_path, "a.yaml", YAML).system, read(tmp_path, "a.dot", DOT).system
    assert one == other
    assert one.successors == ((0, 1), (0,))
    assert one.observation(1) == {"lab", "work"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("transitions: {hall: [attic], attic: []}", "share no side"),
        ("transitions: {hall: [cellar], cellar: []}", "no region `cellar`"),
        ("transitions: {hall: [lab]}", "no state `lab`"),
        ("transitions: {hall: &a [hall], lab: *a}", "without aliases"),
        ("transitions: {hall: [hall]}\nlabels: {lab: [hall]}", "`lab` is a region"),
        ("transitions: {hall: hall", "while parsing"),
        ("[1, 2]", "`transitions`"),
        ("transitions: {hall: 3}", "the states after `hall`: '3' is no list of states"),
        ("transitions: {hall: hall}", "the states after `hall`: 'hall' is no list of states"),
        ("transitions: {hall: [hall]}\ninitial: hall", "`initial`: 'hall' is no list of states"),
        ("transitions: {hall: [hall]}\nlabels: [hall]", "`labels` of a transition system"),
        ("transitions: {hall: [hall]}\nlabels: {work: hall}", "the states with the label `work`"),
        ("x" * 1_000_001, "longer than"),
    ],
)
def test_files_that_are_no_model_are_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        read(tmp_path, "a.yaml", text)


def test_names_in_yaml_are_texts(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("transitions: {on: [off, 1.0], off: [on], 1.0: }\ninitial: [off]")
    model = GraphFile(GraphFile.Parameters.model_validate({"graph": {"file": "a.yaml"}, "places": False}))
    model.folder = tmp_path
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
