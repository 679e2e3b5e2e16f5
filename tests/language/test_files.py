"""A scenario that is opened from a log finds its files for as long as it can run, and leaves none behind."""

import gc
from pathlib import Path
from typing import Any

import yaml

from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.files import open_scenario
from symaware_cli.log.digest import digest
from symaware_cli.log.reader import open_log

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def scenario(components: Any, **more: Any) -> Any:
    shape = {"mesh": {"file": "tent.obj", "radius": 1.0}}
    agents = {"robot": {"count": 2, "model": {"use": "unicycle"}, "state": [5, 0, 0], "components": components}}
    return {
        "symaware": 1,
        "name": "tents",
        "run": {"duration": 0.1},
        "environment": {"use": "pybullet", "entities": {"tent": {"shape": shape, "position": [0, 0, 1]}}},
        "agents": agents,
        **more,
    }


def test_worker_processes_of_a_run_from_a_log_find_its_files(tmp_path: Path) -> None:
    components = {
        "see": {"use": "perception.omniscient"},
        "doubt": {"use": "uncertainty.gaussian", "run_in": "process"},
    }
    first, again = tmp_path / "first" / "log.mcap", tmp_path / "again.mcap"
    first.parent.mkdir()
    (first.parent / "tent.obj").write_text(TETRAHEDRON)
    (first.parent / "s.yaml").write_text(yaml.safe_dump(scenario(components)))
    execute(build(first.parent / "s.yaml"), first)
    (first.parent / "tent.obj").unlink()
    execute(open_scenario(first), again)
    assert digest(open_log(first)).combined == digest(open_log(again)).combined


def test_the_files_of_a_log_are_there_until_its_simulation_is_forgotten(tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    (tmp_path / "tent.obj").write_text(TETRAHEDRON)
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(scenario({})))
    execute(build(tmp_path / "s.yaml"), log)
    built = open_scenario(log)
    folder = built.simulation.environment.folder
    assert (folder / "tent.obj").read_text() == TETRAHEDRON
    built.simulation.environment.close()
    del built
    gc.collect()
    assert not folder.exists()
