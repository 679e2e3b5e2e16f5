"""The hashed bytes are the executed ones, and only if they are trusted."""

import importlib
import json
import os
import sys
from pathlib import Path

import pytest

from symaware_cli.plugin_files import PluginFileError, read_files, trusting
from symaware_cli.plugin_files.file_trust import HANDED_DOWN
from symaware_cli.plugin_files.loading import load_files
from symaware_cli.world import PythonChild, read


def test_untrusted_files_are_not_loaded(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("raise SystemExit")
    with pytest.raises(PluginFileError) as caught:
        load_files(read_files(tmp_path, ["mine.py"]))
    assert caught.value.code == "untrusted-file"


def test_the_bytes_that_were_read_are_executed_though_the_file_changes(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("import helper\nvalue = helper.value")
    (tmp_path / "helper.py").write_text("value = 1")
    files = read_files(tmp_path, ["mine.py"])
    (tmp_path / "mine.py").write_text("value = 'changed'")
    (tmp_path / "helper.py").write_text("value = 'changed'")
    with trusting():
        (name,) = load_files(files).values()
    module = importlib.import_module(name)
    assert module.value == 1
    assert module.__file__ == str(tmp_path.resolve() / "mine.py")


def test_a_local_module_is_neither_that_of_another_folder_nor_visible_elsewhere(tmp_path: Path) -> None:
    for number in (1, 2):
        folder = tmp_path / str(number)
        (folder / "pack").mkdir(parents=True)
        (folder / "mine.py").write_text(
            "import pack.deep, helper\nfrom pack import deep as again\nfrom . import helper as h"
        )
        (folder / "pack" / "deep.py").write_text("import helper\nvalue = helper.value")
        (folder / "helper.py").write_text(f"value = {number}")
    modules = []
    for number in (1, 2):
        with trusting():
            (name,) = load_files(read_files(tmp_path / str(number), ["mine.py"])).values()
        modules.append(importlib.import_module(name))
    assert [module.pack.deep.value for module in modules] == [1, 2]
    assert all(module.again is module.pack.deep and module.h is module.helper for module in modules)
    assert not {"helper", "pack", "mine"} & sys.modules.keys()


def test_a_file_that_came_later_is_not_imported(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("def later():\n    name = 'hel' + 'per'\n    return __import__(name)")
    with trusting():
        (name,) = load_files(read_files(tmp_path, ["mine.py"])).values()
    (tmp_path / "helper.py").write_text("value = 1")
    with pytest.raises(ImportError, match="was not there when its files were read"):
        importlib.import_module(name).later()


def test_a_process_that_is_started_finds_the_same_modules(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("import helper\nvalue = helper.value")
    (tmp_path / "helper.py").write_text("value = 7")
    with trusting():
        (name,) = load_files(read_files(tmp_path, ["mine.py"])).values()
    child = PythonChild(f"{_tell.__module__}:_tell", variables={**os.environ, "NAME": name})
    assert json.loads(read(child.answers)) == 7
    assert child.close() == 0


def test_a_process_that_is_started_refuses_files_that_changed_since(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("value = 7")
    with trusting():
        (name,) = load_files(read_files(tmp_path, ["mine.py"])).values()
    (tmp_path / "mine.py").write_text("value = 8")
    child = PythonChild(f"{_tell.__module__}:_tell", variables={**os.environ, "NAME": name})
    assert "have changed since the run began" in json.loads(read(child.answers))
    assert child.close() == 0


def _tell(requests, answers):  # type: ignore[no-untyped-def]
    from symaware_cli.world import write

    try:
        told = importlib.import_module(os.environ["NAME"]).value
    except ImportError as error:
        told = str(error)
    write(answers, json.dumps(told).encode())


def test_only_digests_are_passed_to_child_processes(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("secret = 1")
    for number in range(40):
        (tmp_path / f"mine{number}.py").write_text("")
        with trusting():
            load_files(read_files(tmp_path, [f"mine{number}.py", "mine.py"]))
    assert "secret" not in os.environ[HANDED_DOWN]
    assert len(json.loads(os.environ[HANDED_DOWN])) <= 16
