"""Scenarios in Python: loaded, checked and run."""

import asyncio
import inspect
import math
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
from asyncio import AbstractEventLoop
from pathlib import Path
from typing import Any
from warnings import WarningMessage

import numpy as np
import pytest
from simulating import Command, present, untyped

import symaware_cli as sa
from symaware_cli import Event, Log, RunResult
from symaware_cli.log.digest import digest


def equal(*logs: Log) -> bool:
    return len({digest(log).combined for log in logs}) == 1


def test_the_package_itself_imports_neither_numpy_nor_more_of_itself_than_three_small_modules() -> None:
    code = (
        "import sys, symaware_cli as sa\n"
        "print([name for name in sys.modules if name.startswith(('numpy', 'symaware_cli.'))])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    names = "['symaware_cli.processor', 'symaware_cli.installed_version', 'symaware_cli.version']"
    assert done.stdout.strip() == names


def test_every_public_name_can_be_imported_and_is_documented() -> None:
    # Forms of values, which are annotations and have no names of their own; docs/time.md describes them.
    forms = {"AgentPattern", "ComponentPattern", "Latency"}
    assert {name for name in sa.__all__ if getattr(getattr(sa, name), "__name__", "") != name} == forms
    for name in set(sa.__all__) - forms:
        assert inspect.getdoc(getattr(sa, name)), name
    assert set(sa.__all__) <= set(dir(sa))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = sa.nonsense


def test_every_public_name_can_be_imported_without_the_extras() -> None:
    extras = [
        *("casadi", "cmaes", "cryptography", "daqp", "foxglove_schemas_protobuf", "highspy", "matplotlib", "optuna"),
        *("pandas", "polars", "pyarrow", "pybullet", "pymunk", "ray", "rerun", "rfc8785", "xarray", "zenoh"),
    ]
    code = f"import sys; sys.modules.update(dict.fromkeys({extras})); from symaware_cli import *"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_scenario_that_was_loaded_tells_what_it_is_about(path: Path) -> None:
    outline = sa.load(path, {"agents.robot.count": 4}).outline
    assert outline is not None
    assert (outline.name, outline.seed, outline.agents, outline.steps, outline.duration) == ("swap", 5, 5, 40, 2.0)
    assert outline.groups["robot"].components == {"sense": "perception.range", "steer": "control.go-to-goal"}
    assert outline.groups["robot"].agents == ("robot.0", "robot.1", "robot.2", "robot.3")


def test_a_problem_is_raised_with_the_text_that_the_command_prints(path: Path, command: Command) -> None:
    path.write_text(path.read_text().replace("unicycle", "unicicle").replace("duration", "durration"))
    with pytest.raises(sa.ScenarioError) as caught:
        sa.load("swap.yaml", {"agents.robto.count": 3})
    printed = command("validate", "swap.yaml", "--set", "agents.robto.count=3").stderr
    assert f"{caught.value}\n" == printed
    assert "did you mean `robot`?" in printed


def test_an_edit_counts_from_the_next_run_on(path: Path) -> None:
    scenario = sa.load(path)
    path.write_text(path.read_text().replace("duration: 2.0", "duration: 1.0"))
    assert scenario.run(record=False).summary.steps == 20
    assert scenario.validate().steps == 20


@pytest.mark.parametrize(
    ("value", "written"),
    [
        (8, "8"),
        (1e-7, "1e-07"),
        (math.inf, ".inf"),
        (None, "null"),
        (True, "true"),
        ("8", '"8"'),
        (np.arange(4.0).reshape(2, 2), "[[0.0, 1.0], [2.0, 3.0]]"),
        (np.float64(0.5), "0.5"),
        ({"circle": {"radius": (1, 2)}}, '{"circle": {"radius": [1, 2]}}'),
    ],
    ids=str,
)
def test_a_change_is_written_as_set_takes_it(value: Any, written: str) -> None:
    assert sa.Scenario("x.yaml", {"a.b": value}).changes == (f"a.b={written}",)


def test_a_change_to_what_no_scenario_holds_is_refused() -> None:
    with pytest.raises(TypeError, match=r"a\.b: a scenario holds no object"):
        sa.Scenario("x.yaml", {"a.b": object()})


def test_changes_of_a_run_come_after_those_of_the_scenario(path: Path) -> None:
    scenario = sa.load(path, ["agents.robot.count=4"], seed=1)
    run = scenario.run({"agents.robot.count": 2}, seed=9, duration=0.5, mode="asynchronous", record=False)
    assert (run.summary.agents, run.summary.seed, run.summary.steps) == (3, 9, 10)
    assert scenario.validate(mode="asynchronous").mode == "asynchronous"
    assert scenario.run(record=False, duration=0.1).summary.seed == 1


def test_a_pace_is_kept_or_taken_away(path: Path) -> None:
    paced = sa.load(path, {"run.pace": 1000.0})
    assert paced.outline is not None
    assert paced.outline.pace == 1000.0
    assert paced.validate(pace=math.inf).pace is None
    assert present(paced.run(pace=500.0, duration=0.1, record=False).summary.pace).factor == 500.0


def test_a_run_has_its_figures_its_series_and_its_events(path: Path) -> None:
    run = sa.load(path).run(seed=3)
    assert (run.status, run.summary.seed, str(run.log_path)) == ("finished", 3, "swap.mcap")
    series = run.series("robot", "world")
    assert series.values.shape == (41, 3, 3)
    assert [event.name for event in run.events][:: len(run.events) - 1] == ["started", "finished"]


def test_a_log_can_be_run_again(path: Path) -> None:
    first = sa.load(path).run(seed=3)
    assert equal(first.log, sa.load("swap.mcap").run().log)


def test_logs_are_named_as_by_the_command(path: Path) -> None:
    scenario = sa.load(path)
    assert [str(scenario.run(duration=0.1).log_path) for _ in range(2)] == ["swap.mcap", "swap-2.mcap"]
    assert present(scenario.run(duration=0.1, output="mine.mcap").log_path).name == "mine.mcap"
    with pytest.raises(sa.LogError, match=r"swap\.yaml is a file of the scenario"):
        scenario.run(output="swap.yaml")
    assert sa.load(path)


def test_a_run_that_is_not_recorded_leaves_nothing_and_says_so(path: Path) -> None:
    run = sa.load(path).run(record=False)
    assert os.listdir() == ["swap.yaml"]
    with pytest.raises(sa.LogError, match="the run of swap was not recorded"):
        run.series("robot", "world")


def test_the_command_prints_what_a_run_prints(path: Path, command: Command) -> None:
    printed = command("run", "swap.yaml", "-o", "a.mcap").stdout.splitlines()
    told = str(sa.load(path).run(output="a.mcap")).splitlines()
    # Wall time is in the log, too, and so the size of that may differ by some bytes.
    one, other = ([re.sub(r"(wall time .*|, [\d.]+ kB)$", "", line) for line in lines] for lines in (printed, told))
    assert one == other


def test_progress_and_events_are_told(path: Path) -> None:
    reached: list[float] = []
    events: list[Event] = []
    sa.load(path).run(record=False, progress=reached.append, on_event=events.append)
    assert reached[0] == 0.05
    assert {event.name for event in events} >= {"started", "contact", "finished"}


@pytest.mark.parametrize("argument", ["progress", "on_event"])
def test_a_function_that_raises_ends_the_run_and_says_so(path: Path, argument: str) -> None:
    def refuse(_: Event | float) -> None:
        raise ValueError("enough")

    with pytest.raises(sa.RunFailedError, match="ValueError: enough"):
        sa.load(path).run(output="a.mcap", **untyped({argument: refuse}))
    assert present(sa.open_log("a.mcap").outcome)["status"] == "failed"


def test_scenarios_and_results_go_to_other_processes(path: Path) -> None:
    scenario = pickle.loads(pickle.dumps(sa.load(path)))
    run = pickle.loads(pickle.dumps(scenario.run(duration=0.1)))
    assert run.series("robot", "world").values.shape == (3, 3, 3)


def test_a_bar_is_shown_where_it_is_asked_for(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = sa.load(path)
    scenario.run(record=False)
    assert capsys.readouterr() == ("", "")
    scenario.run(record=False, progress=True)
    assert capsys.readouterr().out == ""


def test_a_failure_is_raised_with_its_cause_and_the_run_so_far(path: Path, doubles: Path) -> None:
    path.write_text(path.read_text().replace("steer:", "bad: {use: doubles.fault, with: {at: 0.5}}\n      steer:"))
    with pytest.raises(sa.RunFailedError, match=r"failed at 0\.5 s") as caught:
        sa.load(path).run()
    error = caught.value
    assert (error.plugin, error.time) == ("doubles.fault", 0.5)
    assert error.source.endswith(".bad")
    assert type(error.__cause__).__name__ in str(error)
    assert error.run.log.outcome is not None
    assert error.run.status == error.run.log.outcome["status"] == "failed"
    assert error.run.summary.failure == str(error)


def test_ctrl_c_finishes_the_log_and_is_raised(path: Path) -> None:
    def interrupt(time: float) -> None:
        signal.raise_signal(signal.SIGINT)

    handler = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt) as caught:
        sa.load(path).run(progress=interrupt)
    assert isinstance(caught.value, sa.RunInterrupted)
    assert caught.value.run.log.outcome is not None
    assert caught.value.run.status == caught.value.run.log.outcome["status"] == "interrupted"
    assert signal.getsignal(signal.SIGINT) is handler


def test_ctrl_c_as_a_run_ends_is_not_lost(path: Path) -> None:
    def press(event: Event) -> None:
        if event.name == "finished":
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(sa.RunInterrupted) as caught:
        sa.load(path).run(on_event=press)
    assert caught.value.run.log.outcome is not None
    assert caught.value.run.log.outcome["status"] == "finished"


@pytest.mark.parametrize("thread", ["main", "other"])
def test_a_time_out_returns_the_run_as_interrupted(path: Path, thread: str) -> None:
    runs = []

    def run() -> None:
        runs.append(sa.load(path).run(duration=1e6, record=False, timeout=0.3))

    if thread == "main":
        run()
    else:
        other = threading.Thread(target=run)
        other.start()
        other.join(timeout=60)
    assert runs[0].status == "interrupted"


def test_runs_in_several_threads_equal_those_alone_and_leave_the_process_as_it_was(path: Path) -> None:
    scenario, before = sa.load(path), os._exit
    runs = {}
    threads = [
        threading.Thread(target=lambda seed=seed: runs.update({seed: scenario.run(seed=seed, output=f"{seed}.mcap")}))
        for seed in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=120)
    assert os._exit is before
    for seed, run in runs.items():
        assert equal(run.log, scenario.run(seed=seed, output="alone.mcap").log)
    assert len(runs) == 4


@pytest.mark.parametrize("pace", [None, 100.0])
def test_a_run_works_in_a_running_loop_of_asyncio_and_leaves_it_running(path: Path, pace: float | None) -> None:
    async def cell() -> tuple[RunResult, AbstractEventLoop]:
        run = sa.load(path).run(mode="asynchronous", pace=pace, duration=0.5, record=False)
        await asyncio.sleep(0)
        return run, asyncio.get_running_loop()

    run, loop = asyncio.run(cell())
    assert run.status == "finished"
    assert loop is not None


def test_a_limit_of_turns_that_cannot_hold_is_told(path: Path) -> None:
    caught: list[WarningMessage] = []

    def run() -> None:
        with pytest.warns(RuntimeWarning, match="main thread only") as warned:
            sa.load(path, {"run.turn_limit": 5.0})
        caught.extend(warned)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(timeout=60)
    assert len(caught) == 1


def test_two_processes_share_a_run(path: Path) -> None:
    path.write_text(
        path.read_text().replace("perception.range, with: {range: 9.0, position_noise: 0.1}", "perception.omniscient")
    )
    scenario, results = sa.load(path), {}
    ports: list[str] = []
    known = threading.Event()

    def waiting(event: Event) -> None:
        if event.name == "waiting" and not ports:
            ports.append(event.data["address"])
            known.set()

    def host() -> None:
        results["host"] = scenario.run(place=sa.Place.host(0, "lone"), output="host.mcap", on_event=waiting)

    def member() -> None:
        assert known.wait(timeout=60)
        results["member"] = scenario.run(place=sa.Place.member(ports[0], "robot"), output="member.mcap")

    threads = [threading.Thread(target=each) for each in (host, member)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=120)
    assert {name: run.status for name, run in results.items()} == {"host": "finished", "member": "finished"}
    alone = scenario.run().series("robot", "world").values
    assert (results["host"].series("robot", "world").values == alone).all()


def test_what_is_shown_says_what_it_is_and_tables_hold_no_markup_of_others(path: Path) -> None:
    scenario = sa.load(path)
    assert repr(scenario).endswith("swap.yaml: 4 agents in 2 groups, 40 steps>")
    assert "perception.range" in present(scenario._repr_html_())
    run = scenario.run(output="<b>.mcap")
    assert repr(run) == "<RunResult swap: finished after 2 s of simulated time, seed 5, log <b>.mcap>"
    assert "&lt;b&gt;.mcap" in run._repr_html_()
    assert "<b>" not in run._repr_html_()


def test_a_plot_is_one_call_away(path: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    sa.load(path).run().plot("run.png")
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")
