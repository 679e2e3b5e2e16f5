"""The report of a folder lists its logs and sweeps with pictures, verdicts and differences, and executes no name."""

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
import yaml
from typer.testing import CliRunner

import symaware_cli as sa
from symaware_cli.cli.application import application
from symaware_cli.evidence.report.folder_index import IndexEntry, index_entries

SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "meeting",
    "run": {"duration": 0.5},
    "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
    "agents": {
        "robot": {
            "count": 2,
            "model": {"use": "single-integrator", "with": {"process_noise": 0.1}},
            "state": [[0, 0], [1, 0]],
            "knowledge": {"goal": [[1, 0], [0, 0]]},
            "components": {"see": {"use": "perception.self"}, "steer": {"use": "control.go-to-goal"}},
        }
    },
    "specifications": {"apart": {"pairs": "robot", "formula": "always distance > 0.9"}},
}

#: Names of files that would do something if they became markup or an address.
HOSTILE = ("<img src=x onerror=alert(1)>.mcap", "javascript:alert(1).mcap", "data:text'\"&{{7*7}}.mcap")


class Links(HTMLParser):
    """The elements of a page, and what its links lead to."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: set[str] = set()
        self.links: list[str] = []
        self.attributes: set[str] = set()
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.add(tag)
        self.attributes |= {name for name, _ in attrs}
        self.links += [value or "" for name, value in attrs if name == "href"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of two runs that differ in a value, a damaged log, hostile names, a sweep, and a log further down."""
    folder = tmp_path_factory.mktemp("runs")
    file = tmp_path_factory.mktemp("scenario") / "meeting.yaml"
    file.write_text(yaml.safe_dump(SCENARIO), encoding="utf-8")
    scenario = sa.load(file)
    scenario.run(output=folder / "a.mcap")
    scenario.run({"agents.robot.model.with.process_noise": 0.2}, seed=4, output=folder / "b.mcap")
    (folder / "broken.mcap").write_bytes(b"no log")
    for name in HOSTILE:
        (folder / name).write_bytes(b"<script>alert(1)</script>")
    (folder / "deep" / "deeper").mkdir(parents=True)
    (folder / "deep" / "deeper" / "c.mcap").write_bytes((folder / "a.mcap").read_bytes())
    sa.sweep(file, folder / "many", runs=2)
    return folder


@pytest.fixture(scope="module")
def entries(folder: Path) -> dict[str, IndexEntry]:
    return {str(entry.path): entry for entry in index_entries(folder, recursive=True)}


def test_the_index_has_an_entry_for_each_log_and_sweep(entries: dict[str, IndexEntry]) -> None:
    assert set(entries) == {"a.mcap", "b.mcap", "broken.mcap", "deep/deeper/c.mcap", "many", *HOSTILE}
    first, second, sweep = entries["a.mcap"], entries["b.mcap"], entries["many"]
    assert (first.status, first.name, first.facts["agents"]) == ("finished", "meeting", "2 robot")
    assert first.verdicts == [("apart", "violated", "1 of 1")]
    assert first.picture.startswith(b"\x89PNG")
    assert first.differences == []
    assert second.differences[0] == "compared with a.mcap:"
    assert "agents.robot.model.with.process_noise: 0.1 → 0.2" in second.differences
    assert (sweep.status, sweep.verdicts) == ("2 of 2 runs", [("apart", "violated", "2 of 2")])


def test_an_unreadable_log_is_an_entry_with_its_error(entries: dict[str, IndexEntry]) -> None:
    assert "broken.mcap" in entries["broken.mcap"].error
    assert not entries["broken.mcap"].picture


def test_equal_scenarios_are_reported_as_the_same(entries: dict[str, IndexEntry]) -> None:
    assert entries["deep/deeper/c.mcap"].differences == ["compared with a.mcap: the same scenario"]


def test_subfolders_are_searched_only_on_request(folder: Path) -> None:
    with pytest.raises(sa.LogError, match="--recursive"):
        index_entries(folder / "deep")


def test_names_of_files_and_scenarios_are_text_in_the_index(folder: Path, tmp_path: Path) -> None:
    page = sa.write_report(folder, tmp_path / "index.html").read_text(encoding="utf-8")
    parsed = Links(page)
    assert "script" not in parsed.elements
    assert not {name for name in parsed.attributes if name.startswith("on")}
    assert all(link.startswith("./") for link in parsed.links)
    assert {Path(unquote(link)).name for link in parsed.links} == {"a.mcap", "b.mcap", "broken.mcap", "many", *HOSTILE}
    assert "{{7*7}}" in page  # not 49
    assert not re.search(r"https?://", page)
    assert "script" not in re.findall(r'content="(default-src[^"]*)"', page)[0]


def test_the_command_writes_an_index_of_a_folder_and_a_report_of_a_sweep(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(application, ["report", str(folder), "-o", "index.html"])
    assert result.exit_code == 0, result.output
    assert "5 of them unreadable" not in (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "4 of them unreadable" in (tmp_path / "index.html").read_text(encoding="utf-8")
    for arguments, problem in (
        ([str(folder), "--viewer"], "one run"),
        ([str(folder / "a.mcap"), "--recursive"], "folder"),
    ):
        refused = CliRunner().invoke(application, ["report", *arguments])
        assert refused.exit_code == 2
        assert problem in refused.output
