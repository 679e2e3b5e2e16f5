"""Tests that are listed as long exist, and a test that takes too long and is not listed is found."""

import re
from collections import defaultdict
from pathlib import Path

import durations
import pytest
from checkout import CHECKOUT

pytest_plugins = ["pytester"]


def test_the_list_names_existing_tests() -> None:
    listed: dict[str, set[str]] = defaultdict(set)
    for name in durations.listed():
        file, _, function = name.partition("::")
        listed[file].add(function.partition("[")[0].rpartition("::")[2])
    for file, functions in listed.items():
        text = (CHECKOUT / file).read_text(encoding="utf-8")
        gone = [each for each in functions if not re.search(rf"^ *def {each}\(", text, re.MULTILINE)]
        assert not gone, f"{file}: write the list anew (CONTRIBUTING.md)"


BUSY = """\
import time

import pytest


@pytest.mark.parametrize("seconds", [0.0, 0.4])
def test_busy(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
"""


FIRST_IS_SLOW = """\
import time
from pathlib import Path

HERE = Path(__file__).with_name("been_here")


def test_first():
    end = time.process_time() + (0.0 if HERE.exists() else 0.4)
    while time.process_time() < end:
        pass
    HERE.touch()
"""


def test_long_tests_are_listed_left_out_and_missed(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(durations, "LIST", tmp_path / "durations.tsv")
    monkeypatch.setattr(durations, "PACKAGES", ())
    durations.LIST.touch()
    pytester.makeini("[pytest]\nmarkers = long: long\n")
    pytester.makeconftest(
        "import durations\n"
        "def pytest_addoption(parser): durations.add_options(parser)\n"
        "def pytest_configure(config): durations.register(config)\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(CHECKOUT / "tests"))
    pytester.makepyfile(test_first=FIRST_IS_SLOW)
    assert pytester.inline_run("--limit", "0.2", "-p", "no:cacheprovider").ret == pytest.ExitCode.OK
    pytester.path.joinpath("test_first.py").unlink()
    pytester.makepyfile(test_it=BUSY)
    assert pytester.inline_run("--limit", "0.2", "-p", "no:cacheprovider").ret == pytest.ExitCode.TESTS_FAILED
    assert pytester.inline_run("--limit", "5", "-p", "no:cacheprovider").ret == pytest.ExitCode.OK
    assert pytester.inline_run("--record-durations", "-p", "no:cacheprovider").ret == pytest.ExitCode.OK
    assert list(durations.listed()) == ["test_it.py::test_busy[0.4]"]
    pytester.inline_run("-m", "not long", "--limit", "0.2", "-p", "no:cacheprovider").assertoutcome(passed=1)
    pytester.inline_run("-m", "long", "-p", "no:cacheprovider").assertoutcome(passed=1)


def test_the_longest_come_first_and_those_that_are_slow_are_not_long(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(durations, "LIST", tmp_path / "durations.tsv")
    monkeypatch.setattr(durations, "FIRST", 2.0)
    names = {"test_it.py::test_c": 3.0, "test_it.py::test_d": 4.0, "test_it.py::test_b": 1.0}
    durations.LIST.write_text("".join(f"{value}\t{name}\n" for name, value in names.items()))
    pytester.makeini("[pytest]\nmarkers =\n  long: long\n  slow: slow\n")
    pytester.makepyfile(
        test_it="import pytest\n"
        "def test_a(): pass\n"
        "def test_b(): pass\n"
        "def test_c(): pass\n"
        "@pytest.mark.slow\n"
        "def test_d(): pass\n"
    )
    items, _ = pytester.inline_genitems()
    plugin = durations.Durations(record=False, limit=None)
    plugin.pytest_collection_modifyitems(items)
    assert [item.name for item in items] == ["test_d", "test_c", "test_a", "test_b"]
    assert [item.name for item in items if item.get_closest_marker("long")] == ["test_c", "test_b"]


def test_each_file_is_in_one_share_and_an_unknown_share_is_refused(pytester: pytest.Pytester) -> None:
    pytester.makeconftest(
        "import durations\n"
        "def pytest_addoption(parser): durations.add_options(parser)\n"
        "def pytest_configure(config):\n"
        "    if config.option.share: config.pluginmanager.register(durations.Share(config.option.share))\n"
    )
    pytester.makepyfile(**{f"test_{each}": "def test_a(): pass\ndef test_b(): pass\n" for each in "abcdefgh"})
    printed = [pytester.runpytest_inprocess("-v", "--share", f"{share}/3").outlines for share in (1, 2, 3)]
    found = [line.partition(" ")[0] for lines in printed for line in lines if " PASSED" in line]
    assert sorted(found) == [f"test_{file}.py::test_{each}" for file in "abcdefgh" for each in "ab"]
    for wrong in ("0/2", "3/2", "1", "a/b"):
        assert pytester.inline_run("--share", wrong).ret == pytest.ExitCode.USAGE_ERROR
