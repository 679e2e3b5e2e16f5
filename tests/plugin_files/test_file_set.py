"""The files that a scenario names are read with those that they import, and nothing leaves the folder."""

import os
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from symaware_cli.plugin_files import PluginFileError, read_files
from symaware_cli.plugin_files.file_set import MAX_FILES, MAX_SIZE


def files(folder: Path, **contents: str) -> None:
    """Write files; `__` in a name is a slash."""
    for name, content in contents.items():
        path = folder / f"{name.replace('__', '/')}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)


@pytest.mark.parametrize(
    ("text", "needed"),
    [
        ("import numpy, json", []),
        ("import helper", ["helper.py"]),
        ("from helper import x", ["helper.py"]),
        ("from .helper import x", ["helper.py"]),
        ("from . import helper", ["helper.py"]),
        ("def f():\n    import helper", ["helper.py"]),
        ("try:\n    import helper\nexcept ImportError: pass", ["helper.py"]),
        ("import pack.deep", ["pack/__init__.py", "pack/deep.py", "pack/other.py"]),
        ("from pack import deep", ["pack/__init__.py", "pack/deep.py", "pack/other.py"]),
        ("from bare import inner", ["bare/inner.py"]),
        ("import random, yaml, symaware_cli", []),
        ("this is no Python", []),
    ],
)
def test_the_files_that_a_file_imports_are_read_too(tmp_path: Path, text: str, needed: list[str]) -> None:
    files(tmp_path, mine=text, helper="x = 1", pack____init="", bare__inner="", random="", yaml="", symaware_cli="")
    (tmp_path / "pack").mkdir(exist_ok=True)
    files(tmp_path, pack__deep="from .other import y\nimport json", pack__other="y = 2")
    (tmp_path / "pack" / "__init__.py").touch()
    found = read_files(tmp_path, ["mine.py"])
    assert sorted(found.contents) == sorted(["mine.py", *needed])
    assert found.contents["mine.py"] == text.encode()


def test_imports_begin_in_the_folder_of_the_named_file(tmp_path: Path) -> None:
    files(tmp_path, lib__mine="import helper", lib__helper="", helper="")
    assert sorted(read_files(tmp_path, ["lib/mine.py"]).contents) == ["lib/helper.py", "lib/mine.py"]


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("../mine.py", "outside-folder"),
        ("/etc/mine.py", "outside-folder"),
        ("C:\\mine.py", "outside-folder"),
        ("..\\mine.py", "outside-folder"),
        ("mine\0.py", "outside-folder"),
        ("mine.txt", "wrong-type"),
        ("my-file.py", "wrong-type"),
        ("a b.py", "wrong-type"),
        ("gone.py", "missing-file"),
        ("folder.py", "missing-file"),
        ("link.py", "outside-folder"),
        ("linked/mine.py", "outside-folder"),
        ("loop.py", "missing-file"),
        ("large.py", "too-large"),
        (f"{'x' * 300}.py", "missing-file"),
    ],
)
def test_a_name_that_is_no_file_of_the_folder_is_refused(tmp_path: Path, name: str, code: str) -> None:
    home = tmp_path / "home"
    (home / "folder.py").mkdir(parents=True)
    (tmp_path / "mine.py").touch()
    (home / "link.py").symlink_to(tmp_path / "mine.py")
    (home / "linked").symlink_to(tmp_path)
    (home / "loop.py").symlink_to(home / "loop.py")
    (home / "large.py").write_bytes(b"#" * (MAX_SIZE + 1))
    with pytest.raises(PluginFileError) as caught:
        read_files(home, [name])
    assert caught.value.code == code
    assert caught.value.name == name


def test_a_device_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.py")
    with pytest.raises(PluginFileError, match="is no file"):
        read_files(tmp_path, ["pipe.py"])


def test_two_files_with_one_name_and_too_many_files_are_refused(tmp_path: Path) -> None:
    files(tmp_path, mine="", lib__mine="")
    with pytest.raises(PluginFileError, match="two files are called `mine`"):
        read_files(tmp_path, ["mine.py", "lib/mine.py"])
    for number in range(MAX_FILES + 1):
        files(tmp_path, **{f"part{number}": f"import part{number + 1}"})
    with pytest.raises(PluginFileError, match="more than 200 files"):
        read_files(tmp_path, ["part0.py"])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(max_size=12), st.binary(max_size=40))
def test_names_and_contents_of_any_kind_are_read_or_refused(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / "mine.py").write_bytes(content)
    assert read_files(tmp_path, ["mine.py"]).contents["mine.py"] == content
    with suppress(PluginFileError):
        read_files(tmp_path, [name])


def test_the_package_depends_on_names_and_contents_only(tmp_path: Path) -> None:
    one, other, renamed = tmp_path / "one", tmp_path / "other", tmp_path / "renamed"
    files(one, mine="x = 1")
    files(other, mine="x = 1")
    files(renamed, yours="x = 1")
    first = read_files(one, ["mine.py"]).package
    assert read_files(other, ["mine.py"]).package == first
    assert read_files(renamed, ["yours.py"]).package != first
    files(other, mine="x = 2")
    assert read_files(other, ["mine.py"]).package != first
