"""Tracebacks are part of logs, so they do not depend on where packages are installed."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from symaware_cli.world import trace
from symaware_cli.world.exception_text import name_files_from


def text_of(call: object, *arguments: object) -> str:
    try:
        call(*arguments)  # type: ignore[operator]
    except Exception as error:
        return trace(error)
    raise AssertionError


def test_the_same_failure_of_a_package_in_two_places_has_one_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = []
    for place in ("here", "in/another/place"):
        folder = tmp_path / place / "package_that_fails"
        folder.mkdir(parents=True)
        (folder / "__init__.py").touch()
        (folder / "inner.py").write_text("def fail():\n    raise ValueError('so')\n")
        monkeypatch.syspath_prepend(tmp_path / place)
        sys.modules.pop("package_that_fails.inner", None), sys.modules.pop("package_that_fails", None)
        texts.append(text_of(importlib.import_module("package_that_fails.inner").fail))
    assert texts[0] == texts[1]
    assert '  File "package_that_fails/inner.py", line 2, in fail\n    raise ValueError(' in texts[0]
    assert str(tmp_path) not in texts[0]


def test_causes_are_named_in_the_same_way() -> None:
    def fail() -> None:
        try:
            np.linalg.inv(np.zeros((2, 2)))
        except np.linalg.LinAlgError as error:
            raise RuntimeError from error

    text = text_of(fail)
    assert 'File "numpy/linalg/' in text
    assert "The above exception was the direct cause" in text
    assert 'File "/' not in text


def test_files_outside_the_path_have_their_name_or_their_path_in_a_known_folder(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    space: dict[str, object] = {}
    exec(compile("def fail():\n    1 / 0\n", str(tmp_path / "deep" / "alone.py"), "exec"), space)
    assert 'File "alone.py", line 2, in fail' in text_of(space["fail"])
    name_files_from(str(tmp_path))
    assert 'File "deep/alone.py", line 2, in fail' in text_of(space["fail"])
    exec(compile("def fail():\n    1 / 0\n", "<cell 3>", "exec"), space)
    assert 'File "<cell 3>", line 2, in fail' in text_of(space["fail"])
