"""A folder is trusted until one of its files changes; nothing in it, and no damage to the list, makes it trusted."""

import json
from pathlib import Path

import pytest

from symaware_cli.plugin_files import FileSet, forget, read_files, remember, trusted_copy, trusted_folders
from symaware_cli.plugin_files.file_trust import (
    HANDED_DOWN,
    TrustError,
    hand_down,
    is_trusted,
    kept_folder,
    trusting,
)


def test_a_folder_is_trusted_until_a_file_changes(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("import helper")
    (tmp_path / "helper.py").write_text("")
    assert not is_trusted(read_files(tmp_path, ["mine.py"]))
    assert sorted(remember(tmp_path)) == ["helper.py", "mine.py"]
    assert is_trusted(read_files(tmp_path, ["mine.py"]))
    (tmp_path / "helper.py").write_text("changed = True")
    assert not is_trusted(read_files(tmp_path, ["mine.py"]))
    assert is_trusted(read_files(tmp_path, ["helper.py"])) is False
    (tmp_path / "helper.py").write_text("")
    assert is_trusted(read_files(tmp_path, ["mine.py"]))
    assert forget(tmp_path)
    assert not is_trusted(read_files(tmp_path, ["mine.py"]))
    assert not forget(tmp_path)


def test_a_file_that_is_imported_anew_is_not_trusted(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("import helper")
    remember(tmp_path)
    assert is_trusted(read_files(tmp_path, ["mine.py"]))
    (tmp_path / "helper.py").write_text("")
    assert not is_trusted(read_files(tmp_path, ["mine.py"]))


def test_files_are_trusted_where_they_are_copied_together(tmp_path: Path) -> None:
    trusted, copied, mixed = tmp_path / "trusted", tmp_path / "copied", tmp_path / "mixed"
    for folder in (trusted / "sub", copied, mixed):
        folder.mkdir(parents=True)
        (folder / "mine.py").write_text("import helper")
        (folder / "helper.py").write_text("x = 1")
    (trusted / "helper.py").write_text("x = 2")
    (mixed / "helper.py").write_text("x = 2")
    remember(trusted)
    assert is_trusted(read_files(copied, ["mine.py"]))
    # Each file is trusted, but at another place than the other.
    assert not is_trusted(read_files(mixed, ["mine.py"]))
    assert trusted_copy(read_files(copied, ["mine.py"]).digests) == read_files(copied, ["mine.py"]).contents
    assert trusted_copy(read_files(mixed, ["mine.py"]).digests) is None
    (trusted / "sub" / "mine.py").unlink()
    assert trusted_copy(read_files(copied, ["mine.py"]).digests) is None


@pytest.mark.parametrize("content", ["", "[]", "{", '{"/": 3}', '{"/": {"mine.py": 3}}', "\0", "[" * 100_000, "null"])
def test_with_a_damaged_list_no_folder_is_trusted(tmp_path: Path, content: str) -> None:
    (tmp_path / "mine.py").write_text("")
    remember(tmp_path)
    (kept_folder() / "trusted.json").write_text(content)
    assert not is_trusted(read_files(tmp_path, ["mine.py"]))
    assert not trusted_folders()
    remember(tmp_path)
    assert is_trusted(read_files(tmp_path, ["mine.py"]))


@pytest.mark.parametrize("content", ["{", "3", "[3]", '[{"folder": "/"}]', "", "null"])
def test_invalid_data_from_the_parent_process_is_ignored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: str
) -> None:
    (tmp_path / "mine.py").write_text("")
    monkeypatch.setenv(HANDED_DOWN, content)
    files = read_files(tmp_path, ["mine.py"])
    assert not is_trusted(files)
    hand_down(files)
    assert is_trusted(files)


def test_a_relative_configuration_folder_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would be that of the scenario, if one runs it there."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", "configuration")
    monkeypatch.setenv("HOME", str(tmp_path / "user"))
    assert kept_folder() == tmp_path / "user" / ".config" / "symaware"


def test_folders_that_cannot_be_trusted_are_reported(tmp_path: Path) -> None:
    with pytest.raises(TrustError, match="has no Python files"):
        remember(tmp_path)
    with pytest.raises(TrustError, match="is not a folder"):
        remember(tmp_path / "gone")
    for number in range(201):
        (tmp_path / f"part{number}.py").touch()
    with pytest.raises(TrustError, match="more than 200 Python files"):
        remember(tmp_path)
    kept_folder().mkdir(parents=True, exist_ok=True)
    (kept_folder() / "trusted.json").mkdir()
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "mine.py").touch()
    with pytest.raises(TrustError, match="cannot write"):
        remember(tmp_path / "one")


def test_links_out_of_the_folder_and_hidden_folders_are_left_out(tmp_path: Path) -> None:
    home = tmp_path / "home"
    for folder in (home / ".venv", home / "__pycache__", home / "lib"):
        folder.mkdir(parents=True)
        (folder / "inner.py").touch()
    (tmp_path / "out.py").touch()
    (home / "link.py").symlink_to(tmp_path / "out.py")
    assert list(remember(home)) == ["lib/inner.py"]


def test_the_judge_is_called_only_for_files_that_are_not_trusted_yet(tmp_path: Path) -> None:
    (tmp_path / "mine.py").touch()
    files, asked = read_files(tmp_path, ["mine.py"]), list[FileSet]()

    def refuse(each: FileSet) -> bool:
        asked.append(each)
        return False

    with trusting(refuse):
        assert not is_trusted(files)
        remember(tmp_path)
        assert is_trusted(files)
    assert asked == [files]
    assert json.loads((kept_folder() / "trusted.json").read_text()) == {str(tmp_path.resolve()): files.digests}
