"""The files that `symaware new` writes."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from symaware_cli.cli.application import application
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.source_parser import load
from symaware_cli.language.template import TemplateError, template


@pytest.mark.parametrize("toml", [False, True])
def test_a_new_scenario_is_sound_and_runs(tmp_path: Path, toml: bool) -> None:
    path = tmp_path / ("fresh.toml" if toml else "fresh.yaml")
    path.write_text(template("fresh", toml=toml))
    built = build(path)
    assert built.document.name == "fresh"
    summary = execute(built, None)
    assert (summary.status, summary.agents) == ("finished", 3)


def test_both_formats_describe_the_same_scenario(tmp_path: Path) -> None:
    documents = []
    for suffix in ("yaml", "toml"):
        path = tmp_path / f"fresh.{suffix}"
        path.write_text(template("fresh", toml=suffix == "toml"))
        documents.append(load(path, path.name).data)
    assert documents[0] == documents[1]


@pytest.mark.parametrize("toml", [False, True])
def test_a_new_scenario_explains_how_to_run_it_and_its_lines(toml: bool) -> None:
    text = template("fresh", toml=toml)
    assert f"symaware run fresh.{'toml' if toml else 'yaml'}" in text
    assert text.count("#") >= 10
    assert text.splitlines()[2].index("#") == text.splitlines()[3].index("#")
    assert all(len(line) <= 120 and line == line.rstrip() for line in text.splitlines())
    # Quantities are explained with their units.
    assert set(re.findall(r"\[(s|m|m/s|rad)\]", text)) == {"s", "m", "m/s", "rad"}


@pytest.mark.parametrize("name", ["", "1st", "a b", "a/b", "../a", "a.b", "a\n", "é", "x" * 65, "$name"])
def test_an_invalid_name_is_refused(name: str) -> None:
    with pytest.raises(TemplateError):
        template(name)


def test_new_writes_a_file_and_overwrites_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    runner = CliRunner()
    for arguments, name in ((["new", "fresh"], "fresh.yaml"), (["new", "fresh", "--toml"], "fresh.toml")):
        written = runner.invoke(application, arguments)
        assert (written.exit_code, written.stdout) == (0, f"Wrote {name}. Run it with: symaware run {name}\n")
        (tmp_path / name).write_text("mine")
        again = runner.invoke(application, arguments)
        assert (again.exit_code, again.stderr) == (2, f"symaware: {name} exists already\n")
        assert (tmp_path / name).read_text() == "mine"
    assert runner.invoke(application, ["new", "../elsewhere"]).exit_code == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fresh.toml", "fresh.yaml"]
