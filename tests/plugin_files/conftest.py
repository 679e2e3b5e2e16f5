"""Without trust given earlier, by the user or by another test."""

from pathlib import Path

import pytest

from symaware_cli.plugin_files.file_trust import HANDED_DOWN


@pytest.fixture(autouse=True)
def _trusts_nothing(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("configuration")))
    monkeypatch.setenv(HANDED_DOWN, "[]")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, which is the present one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
