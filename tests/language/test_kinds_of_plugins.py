"""Kinds of faults of plugins that fail: each problem is reported at its place, and names the plugin."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from symaware_cli import entry_points
from symaware_cli.language.build import Built
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import Problem

pytestmark = pytest.mark.usefixtures("broken_kinds")


@pytest.fixture(scope="module")
def broken_kinds(known_plugins: None) -> Iterator[None]:
    """Install the kinds that fail besides the other plugins, for these tests only: messages list all kinds."""
    points = {group: list(points) for group, points in entry_points.installed().items()}
    for point in entry_points.points_of("broken-kinds") or ():
        points.setdefault(point.group, []).append(point)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(entry_points, "installed", lambda: points)
        yield


def faulty(sound: dict[str, Any], **fault: Any) -> dict[str, Any]:
    """The sound scenario with one fault."""
    return {**sound, "faults": {"bad": {"at": 0.2, **{key.replace("_", "-"): each for key, each in fault.items()}}}}


@pytest.mark.parametrize(
    ("kind", "written", "path", "message"),
    [
        ("import", {}, "", r"the fault `broken-import` of broken-kinds 1.0 cannot be imported: ImportError: .*"),
        ("abstract", {}, "", r"the fault `broken-abstract` of .* does not implement begin, resolve, text"),
        ("stranger", {}, "", r"the fault `broken-stranger` of .* is not a subclass of Fault"),
        ("unsuitable", "robot", "", r"`broken-unsuitable` cannot work here: the moon is in the wrong house"),
        ("unsuitable", 3, "", r"`faults.bad.broken-unsuitable` is 3"),
        ("crashes", {}, "", r"`broken-crashes` cannot work here: IndexError: .* \(trouble.py, line \d+\)"),
        ("speechless", {}, "", r"`broken-speechless` cannot work here: KeyError: 'text' \(trouble.py, line \d+\)"),
        ("parameters", {"speed": 2.0}, "", r"the Parameters of `broken-parameters` fail: KeyError: 2.0 .*"),
        ("parameters", {"sped": 2.0}, ".sped", r"unknown key `sped`"),
        ("start", {"speed": 2.0}, ".speed", r"unknown key `speed`"),
    ],
)
def test_a_failing_check_is_a_problem_at_the_fault(
    problems: Callable[..., list[Problem]], sound: Any, kind: str, written: Any, path: str, message: str
) -> None:
    (problem,) = problems(faulty(sound, **{f"broken_{kind}": written}))
    assert problem.path == f"faults.bad.broken-{kind}{path}"
    assert problem.span is not None
    assert re.fullmatch(message, problem.message), problem.message


def test_a_kind_whose_name_cannot_be_a_key_is_broken(problems: Callable[..., list[Problem]], sound: Any) -> None:
    content = faulty(sound)
    content["faults"]["bad"]["broken.dotted"] = {}
    (problem,) = problems(content)
    assert "has a name that cannot be a key of faults" in problem.message


def test_the_other_faults_of_a_scenario_with_a_broken_kind_are_checked(
    problems: Callable[..., list[Problem]], sound: Any
) -> None:
    content = faulty(sound, broken_parameters={"speed": 2.0})
    content["faults"]["worse"] = {"at": 0.1, "stop": "nobody"}
    content["faults"]["late"] = {"at": 0.5, "restore": "bad"}
    found = {problem.path for problem in problems(content)}
    assert found == {"faults.bad.broken-parameters", "faults.worse.stop"}


@pytest.mark.parametrize(
    ("kind", "time", "said"),
    [("start", 0.2, "OSError: no wind"), ("end", 0.5, "SystemExit: enough")],
)
def test_an_exception_while_it_runs_is_a_failure_of_the_fault(
    building: Callable[..., Built], sound: Any, tmp_path: Path, kind: str, time: float, said: str
) -> None:
    content = faulty(sound, **{f"broken_{kind}": {}})
    content["faults"]["bad"]["for"] = 0.3
    summary = execute(building(content), tmp_path / "failed.mcap")
    assert summary.status == "failed"
    assert summary.failure == f"faults.bad (broken-{kind}) failed at {time} s: {said}"


def test_only_the_kinds_of_the_scenario_are_imported(building: Callable[..., Built], sound: Any) -> None:
    built = building({**sound, "faults": {"f": {"at": 0.1, "stop": "robot.0"}}})
    assert [*type(built.document.faults["f"]).kinds] == ["stop"]
    assert building(sound).document.faults == {}
