"""Executors of sweeps and search methods for violations are plugins of one file each."""

from __future__ import annotations

import json
import subprocess
from contextlib import chdir
from pathlib import Path

import pytest
from checkout import CHECKOUT
from simulating import in_process

SCENARIOS = CHECKOUT / "scenarios"

EXECUTOR = '''
"""Runs backwards, in this process."""

from contextlib import contextmanager

from symaware_cli.studies.local_execution import LocalExecution
from symaware_cli.studies.sweep_execution import SweepExecution


class Backwards(SweepExecution):
    """Yields the rows of each block in reverse order."""

    @contextmanager
    def executor(self, task):
        assert task.address == "here"
        with LocalExecution().executor(type(task)(task.folder, "", 0, task.count, task.batch)) as made:
            yield Reversed(made)


class Reversed:
    def __init__(self, made):
        self.made = made

    def results(self, blocks):
        yield from reversed(list(self.made.results(blocks)))

    def close(self):
        pass


class Half:
    """Is no execution."""
'''

SEARCH = '''
"""A search along the diagonal."""

import numpy as np

from symaware_cli.evidence.search_method import SearchMethod


class Diagonal(SearchMethod):
    """Looks at equal coordinates, from high to low."""

    def minimise(self, look, names, most, seed):
        for value in np.linspace(1.0, 0.0, most):
            look(np.full((1, len(names)), value))


class Needy(Diagonal):
    """Needs what nobody has."""

    module = "a_module_that_nobody_has"
    install = "pip install it"
'''

ENTRIES = """
[symaware.executors]
backwards = backwards:Backwards
half = backwards:Half

[symaware.searches]
diagonal = diagonal:Diagonal
needy = diagonal:Needy
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Create a folder with a package as installed by pip."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "backwards.py").write_text(EXECUTOR)
    (folder / "diagonal.py").write_text(SEARCH)
    about = folder / "ways-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: ways\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(ENTRIES)
    return folder


def symaware(site: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    with chdir(site):
        return in_process(*arguments, site=site)


def test_an_executor_is_a_plugin_and_does_not_affect_the_table(site: Path, tmp_path: Path) -> None:
    tables = []
    for place in ("local", "backwards:here"):
        out = tmp_path / place.partition(":")[0]
        done = symaware(site, "sweep", SCENARIOS / "hello.yaml", "-o", out, "--runs", 3, "--on", place)
        assert done.returncode == 0, done.stderr
        tables.append((out / "runs.parquet").read_bytes())
    assert tables[0] == tables[1]


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ("forwards", "there is no executor `forwards`; there are backwards, half, local, ray"),
        ("half", "the executor `half` of ways 1.0 is not a subclass of SweepExecution"),
        ("local:7", "`local` has no address, such as `7`"),
    ],
)
def test_an_unknown_executor_is_rejected(place: str, said: str, site: Path, tmp_path: Path) -> None:
    done = symaware(site, "sweep", SCENARIOS / "hello.yaml", "-o", tmp_path / "out", "--runs", 2, "--on", place)
    assert done.returncode == 2
    assert said in done.stderr


def test_a_search_method_is_a_plugin(site: Path, tmp_path: Path) -> None:
    over = ["--over", "agents.robot.model.with.max_speed={uniform: [0.5, 1.5]}"]
    scenario = tmp_path / "line.yaml"
    scenario.write_text(
        """
symaware: 1
name: line
run: {duration: 1.0}
environment: {use: kinematic, with: {time_step: 0.1}}
agents:
  robot:
    model: {use: single-integrator, with: {max_speed: 1.0}}
    state: [0, 0]
    knowledge: {goal: [9, 0]}
    components:
      see: {use: perception.self}
      go: {use: control.go-to-goal}
specifications:
  slow: {each: robot, formula: "always x < 0.8"}
"""
    )
    line = ["falsify", scenario, "--specification", "slow", *over, "--runs", 5, "--jobs", 0, "--json"]
    done = symaware(site, *line, "--method", "diagonal")
    found = json.loads(done.stdout)
    assert (done.returncode, found["method"], found["found"], found["runs"]) == (3, "diagonal", True, 1)
    for method, said in (
        ("spiral", "there is no search method `spiral`; there are"),
        (
            "needy",
            "the method needy needs the module `a_module_that_nobody_has`, which is not installed",
        ),
    ):
        done = symaware(site, *line, "--method", method)
        assert done.returncode == 2
        assert said in done.stdout + done.stderr


def test_executors_and_search_methods_are_listed(site: Path) -> None:
    assert "backwards" in symaware(site, "list", "executors").stdout
    assert "diagonal" in symaware(site, "list", "searches").stdout
