"""Drawings, export formats and sections of reports of plugins: the examples of docs/plugins.md, built as wheels."""

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from documented_plugins import command, shown
from rerun_files import Recording
from simulating import Command

from symaware_cli import open_log

#: One process prepares what all of these tests look at.
pytestmark = pytest.mark.xdist_group("plugins about logs")

#: Each example: its group, its entry point, and the beginning of its file in the document.
EXAMPLES = {
    "drawings": ("mine.homeward", "Homeward", '"""Homeward'),
    "exports": ("jsonl", "JsonLines", '"""JSON Lines'),
    "reports": ("mine.distances", "Distances", '"""Distances'),
}

#: Two robots that cross.
SCENARIO = """\
symaware: 1
name: two
run: {duration: 1.0}
environment: {use: kinematic, with: {time_step: 0.1}}
agents:
  boat:
    count: 2
    entity: {shape: {circle: {radius: 0.2}}}
    model: {use: single-integrator}
    state: [[0, 0], [1, 3]]
    knowledge: {goal: [[4, 0], [0, 0]]}
    components: {see: {use: perception.self}, steer: {use: control.go-to-goal}}
"""

#: Plugins that fail in every way, by group; and one that has the name of a built-in one.
BROKEN = '''\
"""Broken."""

import sys
from typing import ClassVar

import numpy as np

from symaware_cli.drawings import Curves, Drawing, Lines
from symaware_cli.exports import TableFormat
from symaware_cli.reports import DataTable, ReportSection


class Raises(Drawing):
    """Raises an error."""

    def marks(self, chunk):
        raise RuntimeError("no such wind")


class Unmade(Drawing):
    """Cannot be made."""

    def __init__(self, run_view, detail):
        sys.exit("leaving")

    def marks(self, chunk):
        return ()


class NoMark(Drawing):
    """Draws what is no mark."""

    def marks(self, chunk):
        yield "a line"


class Crooked(Drawing):
    """Draws a mark whose arrays do not fit together."""

    def marks(self, chunk):
        yield Lines(path="world/crooked", times=np.array([0]), counts=[7], colours=(1, 2, 3), points=np.zeros((1, 3)),
                    lengths=[5, 5, 5])


class Thief(Drawing):
    """Draws at the path of another drawing."""

    def marks(self, chunk):
        yield Lines(path="world/agents/boat/trail", times=np.array([0]), counts=[0], colours=(1, 2, 3),
                    points=np.zeros((0, 3)), lengths=[])


class Nowhere(Drawing):
    """Draws for an output that there is not."""

    outputs: ClassVar = frozenset({"hologram"})

    def marks(self, chunk):
        return ()


class Format(TableFormat):
    """Fails."""

    table_suffix = ".broken"

    def sheet(self, path, table, about):
        raise ValueError("no such sheet")


class Needy(TableFormat):
    """Needs what nobody has."""

    requires: ClassVar = {"a_module_that_nobody_has": "pip install nothing"}

    def sheet(self, path, table, about):
        raise AssertionError


class Section(ReportSection):
    """Fails."""

    title = "Never"

    def content(self, subject):
        yield DataTable(("a",), [(1 / 0,)])


class Shapeless(ReportSection):
    """Gives what is no block."""

    title = "Never"

    def content(self, subject):
        yield "a block"
'''
BROKEN_POINTS = {
    "drawings": {
        "raises": "Raises",
        "unmade": "Unmade",
        "no-mark": "NoMark",
        "crooked": "Crooked",
        "thief": "Thief",
        "nowhere": "Nowhere",
        "missing": "Missing",
        "agents": "Raises",
    },
    "exports": {"broken": "Format", "needy": "Needy", "csv": "Format"},
    "reports": {"broken": "Section", "shapeless": "Shapeless"},
}


def built(folder: Path, name: str, code: str, points: Mapping[str, Mapping[str, str]]) -> None:
    """Build a package of one file, and install it into a folder of its own."""
    source = folder / f"source-{name}"
    source.mkdir()
    (source / f"{name}.py").write_text(code, encoding="utf-8")
    groups = ""
    for group, targets in points.items():
        lines = (f'"{point}" = "{name}:{target}"\n' for point, target in targets.items())
        groups += f'\n[project.entry-points."symaware.{group}"]\n' + "".join(lines)
    (source / "pyproject.toml").write_text(
        f'[build-system]\nrequires = ["hatchling"]\nbuild-backend = "hatchling.build"\n\n[project]\nname = "{name}"\n'
        f'version = "1.0"\n{groups}\n[tool.hatch.build.targets.wheel]\ninclude = ["{name}.py"]\n',
        encoding="utf-8",
    )
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "install"]
    line: list[str | Path] = [*pip, "--no-deps", "--target", folder / "site", source]
    subprocess.run(line, check=True, timeout=300, cwd=folder)


def log_in(folder: Path) -> Path:
    (folder / "two.yaml").write_text(SCENARIO, encoding="utf-8")
    command(folder)("run", "two.yaml", "--quiet", "--output", "two.mcap", plugin=False)
    return folder / "two.mcap"


@pytest.fixture(scope="module")
def examples(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A folder for each example, with its package installed and a log."""
    folders = {}
    log: Path | None = None
    for group, (name, target, beginning) in EXAMPLES.items():
        folder = tmp_path_factory.mktemp(group)
        # As the document registers it.
        table = shown("toml", f'[project.entry-points."symaware.{group}"]')
        registered = tomllib.loads(table)["project"]["entry-points"][f"symaware.{group}"]
        assert registered == {name: f"my_package:{target}"}
        built(folder, f"my_{group}", shown("python", beginning), {group: {name: target}})
        if log is None:
            log = log_in(folder)
        else:
            (folder / "two.mcap").write_bytes(log.read_bytes())
        folders[group] = folder
    return folders


@pytest.fixture
def symaware(examples: dict[str, Path]) -> Callable[[str], Command]:
    return lambda group: command(examples[group])


@pytest.mark.slow
def test_each_example_is_one_file_that_knows_the_public_interface_alone(examples: dict[str, Path]) -> None:
    for group, folder in examples.items():
        text = (folder / "site" / f"my_{group}.py").read_text(encoding="utf-8")
        assert len(text.splitlines()) < 50
        assert set(re.findall(r"from (symaware_cli\S*)", text)) == {f"symaware_cli.{group}"}


@pytest.mark.slow
def test_each_example_is_listed_and_described(symaware: Callable[[str], Command]) -> None:
    for group, (name, target, _) in EXAMPLES.items():
        listed = json.loads(symaware(group)("list", group, "--json").stdout)
        (own,) = [each for each in listed if each["package"].replace("_", "-") == f"my-{group}"]
        assert (own["kind"], own["name"], own["class"]) == (group[:-1], name, f"my_{group}:{target}")
        assert target.lower() in symaware(group)("show", name).stdout.lower() or group == "exports"


@pytest.mark.slow
def test_a_drawing_of_a_plugin_is_in_replays_plots_and_exports_for_foxglove(
    examples: dict[str, Path], symaware: Callable[[str], Command]
) -> None:
    folder, run = examples["drawings"], symaware("drawings")
    assert "left out" not in run("replay", "two.mcap", "--save", "with.rrd").stderr
    run("replay", "two.mcap", "--save", "without.rrd", plugin=False)
    with_it, without = Recording(folder / "with.rrd"), Recording(folder / "without.rrd")
    assert with_it.entities - without.entities == {"/world/agents/boat/homeward", "/curves/homeward/boat"}
    strips = with_it.values("/world/agents/boat/homeward", "LineStrips3D:strips")
    positions = open_log(folder / "two.mcap").series("boat.0", "world").values.reshape(-1, 2)
    ((x, y, _), (u, v, _)) = strips[-1][0]
    assert [x, y, u, v] == pytest.approx([*positions[0], *positions[-1]], abs=1e-5)
    # Everything else is drawn as before.
    for entity in ("/world/agents/boat/body", "/curves/separation/smallest"):
        for component in {each for each in without.rows if each[0] == entity}:
            assert with_it.rows[component] == without.rows[component]
    facts = json.loads(run("plot", "two.mcap", "--show", "homeward", "--output", "own.svg", "--json").stdout)
    (panel,) = facts["panels"]
    assert panel["panel"] == "homeward boat"
    assert panel["maximum"]["value"] == pytest.approx(max(((positions - positions[0]) ** 2).sum(axis=1) ** 0.5))
    # Only on request, so that other plots do not depend on what is installed.
    run("plot", "two.mcap", "--output", "with.svg")
    run("plot", "two.mcap", "--output", "without.svg", plugin=False)
    assert (folder / "with.svg").read_bytes() == (folder / "without.svg").read_bytes()
    assert "there is no panel" in run("plot", "two.mcap", "--show", "homeward", plugin=False, status=2).stderr
    topics = json.loads(run("export", "two.mcap", "--format", "foxglove", "--json").stdout)["topics"]
    assert topics["/homeward/boat"] > 1


@pytest.mark.slow
def test_a_format_of_a_plugin_writes_the_tables_of_every_other_format(
    examples: dict[str, Path], symaware: Callable[[str], Command]
) -> None:
    folder, run = examples["exports"], symaware("exports")
    written = json.loads(run("export", "two.mcap", "--format", "jsonl", "--json").stdout)["tables"]
    csv = json.loads(run("export", "two.mcap", "--format", "csv", "--json").stdout)["tables"]
    facts = [
        [(each["file"].partition(".")[0], each["rows"], each["columns"]) for each in some] for some in (written, csv)
    ]
    assert facts[0] == facts[1]
    lines = (folder / "two-jsonl" / "state" / "boat.jsonl").read_text(encoding="utf-8").splitlines()
    last = json.loads(lines[-1])
    assert last["agent"] == "boat.1"
    assert last["x"] == open_log(folder / "two.mcap").series("boat.1", "state").column("x")[-1]
    assert "did you mean `jsonl`" in run("export", "two.mcap", "--format", "jsnl", status=2).stderr


@pytest.mark.slow
def test_a_section_of_a_plugin_is_in_the_report(examples: dict[str, Path], symaware: Callable[[str], Command]) -> None:
    folder, run = examples["reports"], symaware("reports")
    run("report", "two.mcap", "--output", "with.html")
    run("report", "two.mcap", "--output", "without.html", plugin=False)
    page, without = ((folder / name).read_text(encoding="utf-8") for name in ("with.html", "without.html"))
    assert re.search(r"<h2>Distances</h2>\s*<table><tr><th>agent</th>.*?<td>boat.1</td>", page, re.S)
    start, end = page.index("<h2>Distances</h2>"), page.index("<h2>The scenario</h2>")
    assert page[:start] + page[end:] == without


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the broken plugins and a log."""
    folder = tmp_path_factory.mktemp("broken")
    built(folder, "broken", BROKEN, BROKEN_POINTS)
    log_in(folder)
    return folder


@pytest.mark.slow
def test_a_replay_shows_all_drawings_except_broken_ones_and_names_these(broken: Path) -> None:
    run = command(broken)
    told = run("replay", "two.mcap", "--save", "with.rrd").stderr.splitlines()
    run("replay", "two.mcap", "--save", "without.rrd", plugin=False)
    expected = [
        ("agents", "has the name of a built-in one"),
        ("raises", "fails: RuntimeError: no such wind (broken.py, line "),
        ("unmade", "fails: SystemExit: leaving"),
        ("no-mark", "draws a str, which is not a mark"),
        ("crooked", "fails: "),
        ("thief", "draws at `world/agents/boat/trail`, a path of Trails"),
        ("nowhere", "has outputs that are not a set of replay, beside, foxglove, plot"),
        ("missing", "cannot be imported: AttributeError: module 'broken' has no attribute 'Missing'"),
    ]
    for name, problem in expected:
        (line,) = [each for each in told if f"the drawing `{name}` of broken 1.0" in each]
        assert problem in line
        assert line.startswith("symaware: ")
        assert line.endswith("it is left out")
    assert len(told) == len(expected)
    with_it, without = Recording(broken / "with.rrd"), Recording(broken / "without.rrd")
    assert without.entities <= with_it.entities
    for component, rows in without.rows.items():
        if component[0] != "/__properties":  # when the recording was made
            assert with_it.rows[component] == rows, component


@pytest.mark.slow
def test_a_broken_format_is_reported_and_leaves_no_file(broken: Path) -> None:
    run = command(broken)
    done = run("export", "two.mcap", "--format", "broken", status=1)
    assert "the export `broken` of broken 1.0 fails: ValueError: no such sheet (broken.py, line" in done.stderr
    assert not (broken / "two-broken").exists()
    needed = "needs the module `a_module_that_nobody_has`, which is not installed: pip install nothing"
    assert needed in run("export", "two.mcap", "--format", "needy", status=2).stderr
    run("export", "two.mcap", "--format", "csv")
    assert (broken / "two-csv" / "agents.csv").exists()


@pytest.mark.slow
def test_a_report_has_all_sections_except_broken_ones(broken: Path) -> None:
    run = command(broken)
    told = run("report", "two.mcap", "--output", "with.html").stderr.splitlines()
    assert len([each for each in told if "the report `broken` of broken 1.0 fails: ZeroDivisionError" in each]) == 1
    assert len([each for each in told if "the report `shapeless` of broken 1.0 fails: " in each]) == 1
    run("report", "two.mcap", "--output", "without.html", plugin=False)
    assert (broken / "with.html").read_text() == (broken / "without.html").read_text()


@pytest.mark.slow
def test_a_name_that_is_built_in_stays_that_of_the_built_in_plugin(broken: Path) -> None:
    run = command(broken)
    listed = run("list", "exports").stdout
    assert re.search(r"csv +broken 1.0 \(not used: the name is built in\)", listed)
    assert re.search(r"csv +symaware-cli \S+\n", listed)
    run("show", "csv")
    run("validate", "two.yaml")
