"""`symaware new`: a scenario to start from."""

import os
from pathlib import Path

import pytest
from simulating import Command


@pytest.mark.parametrize(("options", "name"), [([], "mine.yaml"), (["--toml"], "mine.toml")])
def test_what_it_writes_is_sound_and_runs(options: list[str], name: str, command: Command, tmp_path: Path) -> None:
    done = command("new", "mine", *options)
    assert done.returncode == 0
    assert f"symaware run {name}" in done.stdout
    assert os.listdir(tmp_path) == [name]
    run = command("run", name, "--set", "run.duration=1")
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "mine.mcap").exists()


def test_it_overwrites_nothing(command: Command, tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("precious")
    done = command("new", "mine")
    assert done.returncode == 2
    assert done.stderr == "symaware: mine.yaml exists already\n"
    assert (tmp_path / "mine.yaml").read_text() == "precious"


@pytest.mark.parametrize("name", ["../mine", "a b", "", "9lives", "a/b", "x" * 300])
def test_a_name_that_cannot_be_one_is_refused(name: str, command: Command, tmp_path: Path) -> None:
    done = command("new", "--", name)
    assert done.returncode == 2
    assert done.stderr
    assert os.listdir(tmp_path) == []
