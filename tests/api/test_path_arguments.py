"""Public functions that take paths take text as well as path objects."""

import inspect
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

import symaware_cli as sa

SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "tiny",
    "run": {"duration": 0.2},
    "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
    "specifications": {"near": {"each": "robot", "formula": "always x < 9"}},
    "agents": {"robot": {"count": 2, "model": {"use": "single-integrator"}, "state": [[0, 0], [3, 0]]}},
}

#: An assurance case about the log of a run.
CASE = """
symaware-case: 1
name: case
scenario: tiny.yaml
goals: {G1: {text: They are near, by: [Sn1]}}
solutions: {Sn1: {log: run.mcap, specification: near}}
"""


def assured(at: Path, to: Callable[[Path], Any]) -> None:
    """Make the folder of an assurance case."""
    (at / "case.yaml").write_text(CASE)
    sa.assure(to(at / "case.yaml"), to(at / "case"), level="arithmetic")


def verified(at: Path, to: Callable[[Path], Any]) -> None:
    """Make that folder, and verify it."""
    assured(at, to)
    sa.verify_case(to(at / "case"), "arithmetic")


def multiplied(at: Path, to: Callable[[Path], Any]) -> None:
    """Ask for the product of a claim with itself, which is none."""
    with pytest.raises(sa.SweepError, match="`near` is claimed twice"):
        sa.certify_product([to(at / "out"), to(at / "out")])


#: For each function, what it is called with: the folder that has all files, and what makes paths.
CALLS: dict[str, Callable[[Path, Callable[[Path], Any]], Any]] = {
    "assure": assured,
    "branch": lambda at, to: sa.branch(to(at / "run.mcap"), 0.1, output=to(at / "branch.mcap")),
    "branches": lambda at, to: list(sa.branches(to(at / "run.mcap"), 0.1, [[]], to(at / "branches"))),
    "budget": lambda at, to: sa.budget(
        to(at / "tiny.yaml"), to(at / "budget"), claim="P(near) > 0.1", over="run.duration=0.1,0.2", runs=30
    ),
    "certify": lambda at, to: sa.certify(to(at / "out"), output=to(at / "certificate.json")),
    "certify_product": multiplied,
    "check_log": lambda at, to: sa.check_log(to(at / "run.mcap"), to(at / "stated.yaml")),
    "compare": lambda at, to: sa.compare(to(at / "run.mcap"), to(at / "run.mcap")),
    "compare_sweeps": lambda at, to: sa.compare_sweeps(to(at / "out"), to(at / "out")),
    "env": lambda at, to: sa.env(to(at / "tiny.yaml"), "robot").close(),
    "load": lambda at, to: sa.load(to(at / "tiny.yaml")).run(output=to(at / "loaded.mcap")),
    "open_log": lambda at, to: sa.open_log(to(at / "run.mcap")),
    "open_sweep": lambda at, to: sa.open_sweep(to(at / "out")),
    "single_env": lambda at, to: sa.single_env(to(at / "tiny.yaml"), "robot.0").close(),
    "sweep": lambda at, to: sa.sweep(to(at / "tiny.yaml"), to(at / "swept"), jobs=0),
    "vector_env": lambda at, to: sa.vector_env(to(at / "tiny.yaml"), 2, "robot").close(),
    "verify_case": verified,
    "verify_certificate": lambda at, to: sa.verify_certificate(
        to(at / "out" / "certificate.json"), "arithmetic", folder=to(at / "out")
    ),
    "verify_log": lambda at, to: sa.verify_log(to(at / "run.mcap")),
    "verify_sweep": lambda at, to: sa.verify_sweep(to(at / "out"), "arithmetic"),
    "write_policy": lambda at, to: sa.write_policy(to(at / "policy.onnx"), [([[1.0]], [0.0])]),
}
#: Functions that take minutes or a browser's parts; their paths are those of `sweep` and `open_log`.
ELSEWHERE = {"estimate", "falsify", "write_report"}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    (folder / "tiny.yaml").write_text(yaml.safe_dump(SCENARIO))
    (folder / "stated.yaml").write_text(yaml.safe_dump({"specifications": SCENARIO["specifications"]}))
    sa.load(folder / "tiny.yaml").run(output=folder / "run.mcap")
    sa.sweep(folder / "tiny.yaml", folder / "out", runs=1, claim="P(near) > 0.1 with confidence 0.5", jobs=0)
    sa.certify(folder / "out")
    return folder


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("to", [str, Path], ids=["text", "path"])
def test_a_path_may_be_text(name: str, to: Callable[[Path], Any], files: Path, tmp_path: Path) -> None:
    os.symlink(files / "tiny.yaml", tmp_path / "tiny.yaml")
    for each in ("run.mcap", "stated.yaml", "out"):
        os.symlink(files / each, tmp_path / each)
    CALLS[name](tmp_path, to)


def test_the_table_has_every_public_function_with_a_path() -> None:
    public = {name for name in sa.__all__ if inspect.isfunction(getattr(sa, name))}
    taking = {
        name
        for name in public
        if any(
            word in str(parameter.annotation)
            for parameter in inspect.signature(getattr(sa, name)).parameters.values()
            for word in ("Path", "path")
        )
    }
    assert taking == CALLS.keys() | ELSEWHERE
    for name in taking:
        for parameter in inspect.signature(getattr(sa, name)).parameters.values():
            words = str(parameter.annotation)
            assert (name, "Path" not in words or "FilePath" in words or "PathLike" in words) == (name, True)
