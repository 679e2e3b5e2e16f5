"""The versions of installed packages, and of the numerical kernels."""

import sys
import zipfile
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from symaware_cli.language.package_origin import ORIGIN, package_origin
from symaware_cli.language.versions import versions

FACTS = [
    "Python",
    "platform",
    *([ORIGIN] if package_origin() else []),
    "Processor",
    "NumPy kernels",
    "BLAS",
    "C library",
    "Pinned",
]


def test_the_versions_of_everything_installed_are_known_and_in_order() -> None:
    found = versions()
    assert list(found)[: len(FACTS)] == FACTS
    packages = {name: version for name, version in found.items() if name not in FACTS}
    assert list(packages) == sorted(packages)
    # As they say themselves, but for the spelling of their names.
    for name in ("symaware-cli", "numpy", "pydantic", "pyyaml", "typing-extensions"):
        assert packages[name] == metadata.version(name)
    path = [each for each in sys.path if not each.endswith("thirdparty_files")]  # Ray adds what it brings along
    distributions = metadata.distributions(path=path)
    installed = {each.metadata["Name"].lower().replace("_", "-").replace(".", "-") for each in distributions}
    assert packages.keys() == installed


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A folder at the head of the path."""
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def test_of_a_package_twice_on_the_path_the_imported_one_is_listed(folder: Path) -> None:
    (folder / "numpy-99.dist-info").mkdir()
    assert versions()["numpy"] == "99"


@pytest.mark.parametrize("name", ["Odd_Name-1.5.dist-info", "odd.name-1.5-py3.11.egg-info", "odd_name.egg-info"])
def test_names_of_packages_have_one_spelling_for_every_installer(name: str, folder: Path) -> None:
    (folder / name).mkdir()
    (folder / name / "PKG-INFO").write_text("Metadata-Version: 1.0\nName: odd-name\nVersion: 1.5\n")
    assert versions()["odd-name"] == "1.5"


def test_a_folder_without_a_name_and_a_missing_one_are_skipped(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "broken.dist-info").mkdir()
    monkeypatch.syspath_prepend(folder / "missing")
    assert "broken" not in versions()


def test_packages_in_a_zip_file_are_known(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with zipfile.ZipFile(folder / "bundle.zip", "w") as bundle:
        bundle.writestr("bundled-2.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: bundled\nVersion: 2.0\n")
    monkeypatch.setattr(sys, "path", [str(folder / "bundle.zip"), *sys.path])
    assert versions()["bundled"] == "2.0"
