"""Entry points: those of all installed packages, read once until a package is installed or removed."""

import shutil
from importlib import metadata
from pathlib import Path

import pytest

from symaware_cli import entry_points

GROUP = "symaware.components"


def names() -> set[str]:
    return {point.name for point in entry_points.installed().select(group=GROUP)}


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
    monkeypatch.setattr(metadata, "entry_points", lambda: pytest.fail("the metadata is read again"))
    assert names() == known


def test_a_folder_of_the_search_path_may_appear_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = names()
    monkeypatch.syspath_prepend(tmp_path / "later")
    assert names() == before
    install(tmp_path / "later", "early")
    assert names() == before | {"early.one"}
