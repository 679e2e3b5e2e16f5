"""A scenario in Python: `use` may be a class or a function, and the log shows which can be repeated."""

import functools
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from own_files import CONTROLLER
from simulating import in_process

import symaware_cli as sa


@sa.controller
def home(state, knowledge, time):  # type: ignore[no-untyped-def]
    """Heads for the goal."""
    return knowledge["goal"] - state


@sa.component("mine.right")
class Right(sa.Controller):
    """Goes to the right."""

    def _compute(self) -> tuple[Any, ...]:
        return [1.0, 0.0], sa.TimeSeries()


def document(use: Any, **further: Any) -> dict[str, Any]:
    return {
        "symaware": 1,
        "name": "inline",
        "run": {"duration": 0.5},
        "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
        "agents": {
            "robot": {
                "count": 2,
                "model": {"use": "single-integrator"},
                "knowledge": {"goal": np.array([3.0, 0.0])},
                "components": {"steer": {"use": use}},
            }
        },
        **further,
    }


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("use", "name"),
    [
        (home, "test_inline_scenario.home"),
        (home.__dict__["__wrapped__"], "test_inline_scenario.home"),
        (Right, "mine.right"),
        ("mine.right", "mine.right"),
        ("control.go-to-goal", "control.go-to-goal"),
        (lambda state, knowledge, time: [1.0, 0.0], "test_inline_scenario.<lambda>"),
        (functools.partial(lambda gain, state, knowledge, time: [gain, 0.0], 1.0), None),
    ],
)
def test_use_is_a_class_a_function_or_a_name(use: Any, name: str | None) -> None:
    if name is None:
        with pytest.raises(TypeError, match="has no name"):
            sa.scenario(document(use))
        return
    scenario = sa.scenario(document(use))
    result = scenario.run(output="inline.mcap")
    assert result.status == "finished"
    assert scenario.outline is not None
    assert scenario.outline.groups["robot"].components == {"steer": name}
    x = sa.open_log("inline.mcap").series("robot.1", "world").values[-1, 0]
    assert 0.3 < x < 2.0
    assert sa.verify_log("inline.mcap").difference is None, "this program still has it"


def test_a_class_that_is_installed_is_known_by_its_name() -> None:
    from symaware_cli.engine.components.perception import SelfPerception

    scenario = sa.scenario(document(SelfPerception))
    assert scenario.outline is not None
    assert scenario.outline.groups["robot"].components == {"steer": "perception.self"}
    assert "plugins" not in scenario.run(record=False).summary.to_json()


def test_a_class_in_a_file_of_the_folder_is_repeated_from_the_log_alone(folder: Path) -> None:
    (folder / "ours.py").write_text(CONTROLLER)
    program = (
        "import symaware_cli as sa\nfrom ours import Go\nfrom test_inline_scenario import document\n"
        "sa.scenario(document(Go)).run(output='inline.mcap')\n"
    )
    (folder / "program.py").write_text(program)
    tests = str(Path(__file__).parent)
    subprocess.run(
        [
            sys.executable,
            "-c",
            f"import sys; sys.path[:0] = ['.', {tests!r}, {str(Path(tests).parent)!r}]; import program",
        ],
        check=True,
    )
    (folder / "ours.py").unlink()
    (folder / "program.py").unlink()
    verified = in_process("verify", "inline.mcap", "--trust")
    assert verified.returncode == 0, verified.stderr
    assert "trusted ours.py" in verified.stderr


@pytest.mark.parametrize("use", ["steer", "lambda state, knowledge, time: [1, 0]", "Steer"])
def test_a_class_of_the_program_alone_runs_and_is_not_repeated_without_it(folder: Path, use: str) -> None:
    program = f"""\
import sys
sys.path[:0] = {[str(Path(__file__).parent), str(Path(__file__).parent.parent)]!r}
import symaware_cli as sa
from test_inline_scenario import document

@sa.controller
def steer(state, knowledge, time):
    return [1, 0]

class Steer(sa.Controller):
    def _compute(self):
        return [1, 0], sa.TimeSeries()

sa.scenario(document({use})).run(output="inline.mcap")
"""
    (folder / "program.py").write_text(program)
    subprocess.run([sys.executable, "program.py"], check=True)
    for trust in ([], ["--trust"]):
        verified = in_process("verify", "inline.mcap", *trust)
        assert verified.returncode == 2
        assert "was defined by the program that made this scenario" in verified.stderr
        assert "1 problem in" in verified.stderr
    # Everything that needs no code reads it.
    assert in_process("inspect", "inline.mcap").returncode == 0


def test_a_class_of_the_main_program_is_refused_in_workers(folder: Path) -> None:
    kind = type("Steer", (Right,), {"__module__": "__main__"})
    with pytest.raises(sa.ScenarioError, match="is a class of the main program"):
        sa.scenario(document(kind), {"agents.robot.components.steer.run_in": "process"})


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (lambda: document(int), "`builtins.int` is not a plugin"),
        (lambda: document(home, runn=3), "did you mean `run`?"),
        (lambda: document(home, run={"duration": -1.0}), "run.duration"),
        (lambda: document("no.such"), "no component called `no.such`"),
        (lambda: {"symaware": 1}, "missing"),
        (dict, "missing"),
    ],
)
def test_problems_are_located_at_the_call(wrong: Callable[[], Any], told: str) -> None:
    content = wrong()
    with pytest.raises(sa.ScenarioError) as caught:
        sa.scenario(content)  # here
    problems = caught.value.problems
    assert any(
        told in f"{each.message} did you mean `{each.suggestion}`?" or told in each.path or told in str(each.expected)
        for each in problems
    ), problems
    assert {(each.span.file, each.source_line and each.source_line.strip()) for each in problems if each.span} == {
        ("test_inline_scenario.py", "sa.scenario(content)  # here")
    }


@pytest.mark.parametrize("value", [object(), {1, 2}, 3j, b"x"])
def test_a_value_that_no_file_could_have_is_refused(value: Any) -> None:
    with pytest.raises(TypeError, match="a scenario holds no"):
        sa.scenario(document(home, description=value))


def test_a_function_with_other_arguments_is_refused_by_the_decorator() -> None:
    with pytest.raises(TypeError, match=r"`wrong` takes \(state, knowledge, time\)"):

        @sa.controller  # type: ignore[arg-type]
        def wrong(state: Any) -> Any:
            return state


@pytest.mark.parametrize("name", ["", "two words", "a..b", 3, "1.x"])
def test_a_name_is_that_of_a_plugin(name: Any) -> None:
    with pytest.raises(ValueError, match="is not a name of a plugin"):
        sa.component(name)


def test_changes_and_seeds_are_as_for_a_file() -> None:
    scenario = sa.scenario(document(home), {"agents.robot.count": 3}, seed=5)
    assert scenario.outline is not None
    assert (scenario.outline.agents, scenario.outline.seed) == (3, 5)
    assert scenario.run(["run.duration=0.1"], seed=6, record=False).summary.seed == 6
    with scenario.start() as simulation:
        simulation.step(2)
        assert simulation.state("robot").shape == (3, 2)


def test_a_function_of_an_event_is_a_subscriber() -> None:
    heard: list[str] = []
    subscribers = {"tell": {"use": lambda event: heard.append(event.name), "event": "stepped"}}
    sa.scenario(document(home, subscribers=subscribers)).run(record=False)
    assert heard == ["stepped"] * 10


def test_a_class_that_is_defined_again_replaces_the_former_one() -> None:
    for speed in (1.0, 2.0):

        @sa.component("mine.again")
        class Again(sa.Controller):
            value = speed

            def _compute(self) -> tuple[Any, ...]:
                return [self.value, 0.0], sa.TimeSeries()

        sa.scenario(document("mine.again")).run(output="inline.mcap")
        x = sa.open_log("inline.mcap").series("robot.1", "world").values[-1, 0]
        assert x == pytest.approx(0.5 * speed)
