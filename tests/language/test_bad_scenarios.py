"""tests/scenarios/bad/ holds broken scenarios, each beside the report that `symaware validate` prints for it.

To see them as a user does: `cd tests/scenarios/bad; PYTHONPATH=../../scenario/plugins symaware validate nan.yaml`.
A file whose first line is `# args: ...` is validated with these options. To write the reports anew after a wording has
changed: `SYMAWARE_WRITE_REPORTS=1 pytest tests/language/test_bad_scenarios.py`, then read the difference.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from checkout import CHECKOUT
from typer.testing import CliRunner

from symaware_cli import __version__
from symaware_cli.cli.application import application

BAD = CHECKOUT / "tests" / "scenarios" / "bad"
PLUGINS = Path(__file__).parent / "plugins"
FILES = sorted(path.name for path in BAD.iterdir() if path.suffix in (".yaml", ".toml"))
WRITE = bool(os.environ.get("SYMAWARE_WRITE_REPORTS"))


@pytest.fixture(scope="module", autouse=True)
def _installed(known_plugins: None) -> Iterator[None]:
    """Run beside the files, with only the built-in plugins and those of these tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(BAD)
        # What a plugin that needs an extra finds where the extra is not installed.
        patch.setitem(sys.modules, "pybullet", None)
        for name in ("bullet", "spatial"):
            patch.delitem(sys.modules, f"symaware_cli.worlds.{name}", raising=False)
        yield


def options(name: str) -> list[str]:
    first = (BAD / name).read_bytes().partition(b"\n")[0].decode("utf-8", "replace")
    return shlex.split(first.removeprefix("# args:")) if first.startswith("# args:") else []


def validate(name: str, *more: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(application, ["validate", name, *options(name), *more])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    # Between two releases, each commit has a version of its own.
    return result.exit_code, result.stdout, result.stderr.replace(f"symaware-cli {__version__}", "symaware-cli VERSION")


@pytest.mark.parametrize("name", FILES)
def test_a_broken_file_gives_exactly_the_expected_report(name: str) -> None:
    status, out, err = validate(name)
    if WRITE:
        (BAD / f"{name}.expected").write_text(err, encoding="utf-8")
    assert (status, out) == (2, "")
    assert err == (BAD / f"{name}.expected").read_text(encoding="utf-8")
    assert "Traceback" not in err
    assert all(character.isprintable() or character in "\n" for character in err)


@pytest.mark.parametrize("name", FILES)
def test_the_report_for_tools_has_the_places_of_the_text_once_each(name: str) -> None:
    status, out, err = validate(name, "--json")
    assert (status, err) == (2, "")
    report = json.loads(out)
    assert report["valid"] is False
    assert report["problems"]
    for problem in report["problems"]:
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", problem["code"])
        assert problem["message"].strip()
        assert not problem["message"].endswith(".")
        assert isinstance(problem["path"], str)
        span = problem["span"]
        text = span["file"].removeprefix("--set ")
        if text == span["file"]:
            text = Path(text).read_text(encoding="utf-8", errors="replace").removeprefix("\ufeff")
        line = re.split(r"\r\n|\n|\r", text)[span["line"] - 1]
        assert line == problem["source_line"]
        assert 1 <= span["column"] < span["end_column"]
        assert span["column"] <= len(line) + 1
        if problem["code"] in ("unknown-key", "duplicate-key"):
            marked = line[span["column"] - 1 : span["end_column"] - 1].strip("\"'")
            assert marked == problem["path"].rpartition(".")[2]
    # Several fields may be missing in one place; apart from that no place has two problems.
    problems = [each for each in report["problems"] if each["code"] != "missing-field"]
    starts = {(each["span"]["file"], each["span"]["line"], each["span"]["column"]) for each in problems}
    assert len(starts) == len(problems)


def test_there_are_many_broken_files_of_both_formats() -> None:
    assert len(FILES) >= 40
    assert len([name for name in FILES if name.endswith(".toml")]) >= 18
    assert len([name for name in FILES if name.endswith(".yaml")]) >= 40
    reports = {path.name.removesuffix(".expected") for path in BAD.glob("*.expected")}
    assert reports == set(FILES)


def test_the_same_fault_is_reported_in_the_same_words_in_both_formats() -> None:
    def told(name: str) -> list[tuple[object, ...]]:
        problems = json.loads(validate(name, "--json")[1])["problems"]
        for each in problems:
            each["message"] = re.sub(r"line \d+", "line N", each["message"])
        return [tuple(each[key] for key in ("code", "message", "path", "expected", "suggestion")) for each in problems]

    # Where the two languages say a thing differently, or the files differ on purpose.
    differing = {"duration-of-zero", "fraction-for-a-count", "missing-base", "missing-field", "missing-use"}
    differing |= {"nested-too-deep", "not-utf-8", "number-too-large", "plugin-of-another-kind", "several-problems"}
    differing |= {"unclosed-brace", "unknown-choice", "wrong-version"}
    stems = [Path(name).stem for name in FILES]
    pairs = {stem for stem in stems if stems.count(stem) == 2}
    assert len(pairs - differing) >= 18
    for stem in sorted(pairs - differing):
        assert told(f"{stem}.yaml") == told(f"{stem}.toml"), stem


def test_the_scenario_that_all_of_them_break_is_sound() -> None:
    assert validate("bases/sound.yaml") == (0, "bases/sound.yaml: sound; 2 agents in 1 group, 100 steps\n", "")


def test_a_file_of_two_megabytes_is_refused_before_it_is_parsed(tmp_path: Path) -> None:
    for suffix in ("yaml", "toml"):
        large = tmp_path / f"large.{suffix}"
        large.write_text("# " + "x" * 2_000_000)
        result = CliRunner().invoke(application, ["validate", str(large)])
        assert result.exit_code == 2
        assert "is larger than 1 MiB, the most a scenario file may have" in result.stderr


@pytest.mark.parametrize(
    "name", ["several-problems.yaml", "several-problems.toml", "plugin-that-exits.yaml", "set-of-an-unknown-group.toml"]
)
def test_running_a_broken_file_reports_the_same_and_creates_no_log(
    name: str, tmp_path: Path, command: Callable[..., subprocess.CompletedProcess[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(BAD / name, tmp_path)
    done = command("run", name, *options(name))
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (BAD / f"{name}.expected").read_text(encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == [name]
