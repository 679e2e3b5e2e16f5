"""Entry points: those of all installed packages, read once until a package is installed or removed."""

import os
import shutil
import subprocess
import sys
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

from symaware_cli import entry_points

GROUP = "symaware.components"


def names() -> set[str]:
    return {point.name for point in entry_points.installed()[GROUP]}


def install(folder: Path, package: str) -> Path:
    about = folder / f"{package}-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[{GROUP}]\n{package}.one = {package}:One\n")
    return about


def test_a_package_that_is_installed_or_removed_is_seen_by_the_next_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = names()
    install(tmp_path, "early")
    monkeypatch.syspath_prepend(tmp_path)
    assert names() == before | {"early.one"}
    late = install(tmp_path, "late")
    assert names() == before | {"early.one", "late.one"}
    shutil.rmtree(late)
    assert names() == before | {"early.one"}
    monkeypatch.undo()
    assert names() == before


def test_the_metadata_of_packages_is_read_once_while_nothing_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    known = names()
    monkeypatch.setattr(entry_points, "open", lambda *_, **__: pytest.fail("a file is read again"), raising=False)
    assert names() == known


def test_a_folder_of_the_search_path_may_appear_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = names()
    monkeypatch.syspath_prepend(tmp_path / "later")
    assert names() == before
    install(tmp_path / "later", "early")
    assert names() == before | {"early.one"}


def test_entry_points_are_those_that_the_standard_library_finds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, "early")
    install(tmp_path / "second", "Early")
    about = tmp_path / "odd_name-2.0-py3.11.egg-info"
    about.mkdir()
    (about / "PKG-INFO").write_text("Metadata-Version: 2.1\nName: odd.name\nVersion: 2.0\n\nVersion: 3.0\n")
    (about / "entry_points.txt").write_text(
        f"[console_scripts]\na = b:c\n\n# note\n[{GROUP}]\n ; = \n odd = odd_name : Odd [extra]\n# x = y\n"
        f"[{GROUP}.more]\nx=y\n"
    )
    archive = tmp_path / "archived.zip"
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("zipped-3.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: zipped\nVersion: 3.0\n")
        file.writestr("zipped-3.0.dist-info/entry_points.txt", f"[{GROUP}]\nzipped.one = zipped:One\n")
    for folder in (archive, tmp_path / "second", tmp_path, tmp_path / "absent"):
        monkeypatch.syspath_prepend(folder)
    expected = {
        (point.group, point.name, point.value, point.dist.name, point.dist.version)
        for group in (GROUP, f"{GROUP}.more")
        for point in metadata.entry_points(group=group)
        if point.dist is not None
    }
    assert {tuple(each) for group in (GROUP, f"{GROUP}.more") for each in entry_points.installed()[group]} == expected
    assert {("odd", "odd.name"), ("zipped.one", "zipped")} <= {(name, package) for _, name, _, package, _ in expected}


def test_a_plugin_that_is_edited_is_seen_by_the_next_process(tmp_path: Path) -> None:
    about = install(tmp_path, "early")
    code = f"from symaware_cli import entry_points; print([each.name for each in entry_points.installed()[{GROUP!r}]])"

    def seen() -> str:
        return subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout

    assert "'early.one'" in seen()
    (about / "entry_points.txt").write_text(f"[{GROUP}]\nearly.two = early:Two\n")
    later = seen()
    assert "'early.two'" in later
    assert "'early.one'" not in later
