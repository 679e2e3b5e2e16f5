"""Whatever goes wrong in a run is named, recorded with its traceback, and ends the run with its log finished."""

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from simulating import STEP, Command, Team, execute, present, simulate, simulation

from symaware_cli import (
    Agent,
    AwarenessDatabase,
    Component,
    Contact,
    Entity,
    Event,
    GroupComponent,
    KnowledgeDatabase,
    open_log,
)
from symaware_cli.api.scenario import Mode
from symaware_cli.core import Snapshot
from symaware_cli.core.entity_group import EntityGroup
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.log.logged_events import LoggedEvent

BODY = Entity.model_validate({"shape": {"circle": {"radius": 0.8}}})


class TroubleError(Exception):
    """What tests raise."""


class Plain(Component):
    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        pass


class Faulty(Component):
    """Fails for one agent at one time; a class for each example."""

    row = 0
    at = 0
    where = "_compute"
    value = None

    def _maybe(self, where: str) -> None:
        if self._agent.row == self.row and self.now == self.at and self.where == where:
            if self.value is None:
                raise TroubleError("on purpose")
            if "control" in where:
                self._agent.model.control_input = [self.value, 0.0]
            else:
                self._agent.self_awareness.state = [0.0, self.value]

    def initialise_component(
        self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, KnowledgeDatabase]
    ) -> None:
        super().initialise_component(agent, awareness, knowledge)
        self._maybe("initialise_component")
        if self.where == "subscriber":
            self.subscribe("tick", self._on_tick)

    def _on_tick(self, event: Event) -> None:
        self._maybe("subscriber")

    def _compute(self) -> None:
        self._maybe("_compute")

    def _update(self, value: Any) -> None:
        for where in ("_update", "control input", "state"):
            self._maybe(where)
        self.emit("tick")


def failure(log_path: Path) -> LoggedEvent:
    """The log must be whole, end with exactly one `failed` event, and say so in its outcome; that event."""
    log = open_log(log_path)
    assert log.verify() is None
    events = list(log.events())
    failed = [event for event in events if event.name == "failed"]
    assert len(failed) == 1
    assert events[-1] == failed[0]
    assert present(log.outcome)["status"] == "failed"
    assert failed[0].level == "ERROR"
    return failed[0]


faults = st.fixed_dictionaries(
    {
        "where": st.sampled_from(
            ["_compute", "_update", "initialise_component", "subscriber", "control input", "state"]
        ),
        "count": st.integers(1, 3),
        "row": st.integers(0, 2),
        "before": st.integers(0, 2),
        "after": st.integers(0, 2),
        "step": st.integers(0, 6),
        "value": st.sampled_from([float("nan"), float("inf"), float("-inf")]),
    }
)


@settings(max_examples=60)
@given(faults)
def test_a_fault_of_any_component_at_any_time_is_named_and_recorded(fault: dict[str, Any]) -> None:
    row, where = fault["row"] % fault["count"], fault["where"]
    step = 0 if where == "initialise_component" else fault["step"]
    is_value = where in ("control input", "state")
    attributes = {"row": row, "at": step * STEP, "where": where, "value": fault["value"] if is_value else None}
    components: dict[str, Any] = {f"before-{number}": Plain for number in range(fault["before"])}
    components |= {"fault": type("Faulty", (Faulty,), attributes)}
    components |= {f"after-{number}": Plain for number in range(fault["after"])}
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        summary = simulate({"robot": Team(components, count=fault["count"])}, steps=8, log=log)
        event = failure(log)
        outcome = open_log(log).outcome
        recorded = open_log(log).end_time
    assert summary.status == "failed"
    assert outcome is not None
    assert summary.steps == outcome["steps"] == step
    assert event.time == recorded == outcome["time"] == step * STEP
    assert event.source == f"agents.robot.{row}.fault"
    facts = {key: event.data[key] for key in ("agent", "component", "plugin", "time")}
    assert facts == {"agent": f"robot.{row}", "component": "fault", "plugin": "test.fault", "time": step * STEP / 1e9}
    for said in (event.text, summary.failure):
        assert said is not None
        assert f"robot.{row}" in said
        assert "test.fault" in said
    if is_value:
        assert f"its {where} is not finite" in event.data["problem"]
        assert str(fault["value"]) in event.data["problem"]
    else:
        assert "TroubleError: on purpose" in event.data["problem"]
        assert "Traceback (most recent call last)" in event.data["traceback"]
        assert "_maybe" in event.data["traceback"]


@pytest.mark.parametrize("rows", [[0], [1, 3]])
def test_a_group_component_that_writes_nan_is_blamed_with_the_agent_concerned(rows: list[int], tmp_path: Path) -> None:
    class Bad(GroupComponent):
        def _compute(self) -> Any:
            values = np.zeros((4, 2))
            values[rows] = np.nan
            return values

        def _update(self, value: Any) -> None:
            self._group.control_input = value

    summary = simulate({"robot": Team({"bad": Bad}, count=4)}, log=tmp_path / "run.mcap")
    event = failure(tmp_path / "run.mcap")
    assert event.source == f"agents.robot.{rows[0]}.bad"
    assert event.data["plugin"] == "test.bad"
    assert ("1 more agent" in present(summary.failure)) == (len(rows) > 1)


def test_a_group_component_that_raises_is_blamed_with_its_group(tmp_path: Path) -> None:
    class Bad(GroupComponent):
        def _compute(self) -> None:
            raise TroubleError("on purpose")

        def _update(self, value: Any) -> None:
            pass

    simulate({"robot": Team({"bad": Bad}, count=4)}, log=tmp_path / "run.mcap")
    assert failure(tmp_path / "run.mcap").source == "agents.robot.bad"


@pytest.mark.parametrize("what", ["step", "state", "snapshot", "contacts", "applied_input"])
@pytest.mark.parametrize("count", [2, 70])
def test_a_world_that_raises_is_blamed_wherever_it_does(what: str, count: int, tmp_path: Path) -> None:
    class Breaks(KinematicEnvironment):
        def _break(self, method: str) -> None:
            if method == what and self._time >= 2 * STEP:
                raise TroubleError("on purpose")

        def step(self) -> None:
            self._break("step")
            super().step()

        def state(self, group: EntityGroup) -> NDArray[np.float64]:
            self._break("state")
            return super().state(group)

        def snapshot(self) -> Snapshot:
            self._break("snapshot")
            return super().snapshot()

        def contacts(self) -> Sequence[Contact]:
            self._break("contacts")
            return super().contacts()

        def applied_input(self, group: EntityGroup) -> NDArray[np.float64]:
            self._break("applied_input")
            return super().applied_input(group)

    summary = simulate({"robot": Team(count=count)}, steps=8, log=tmp_path / "run.mcap", environment=Breaks())
    event = failure(tmp_path / "run.mcap")
    assert summary.status == "failed"
    assert (event.source, event.data["plugin"], event.data["agent"]) == ("environment", "test-world", None)
    assert "TroubleError: on purpose" in event.data["problem"]
    assert "_break" in event.data["traceback"]


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("count", [1, 3, 100])
def test_a_world_that_loses_its_numbers_is_blamed_with_the_agent_concerned(
    value: Any, count: int, tmp_path: Path
) -> None:
    class Breaks(KinematicEnvironment):
        def step(self) -> None:
            super().step()
            state = self._states[0].copy()
            state[count - 1, 1] = value
            state.flags.writeable = False
            self._states[0] = state

    summary = simulate({"robot": Team(count=count)}, log=tmp_path / "run.mcap", environment=Breaks())
    event = failure(tmp_path / "run.mcap")
    assert event.data["problem"].startswith(f"the state of robot.{count - 1} is not finite")
    assert summary.status == "failed"


@pytest.mark.parametrize("count", [2, 100])
def test_a_state_that_grows_beyond_all_bounds_is_reported_as_such(count: int, tmp_path: Path) -> None:
    class Explodes(GroupComponent):
        def _compute(self) -> Any:
            return np.full((count, 2), 1.7e308)

        def _update(self, value: Any) -> None:
            self._group.control_input = value

    with np.errstate(all="ignore"):
        simulate({"robot": Team({"bad": Explodes}, count=count, entity=BODY)}, steps=100, log=tmp_path / "run.mcap")
    assert "the state of robot.0 has run away, beyond 1e+15" in failure(tmp_path / "run.mcap").data["problem"]


def raising(error: BaseException) -> type[Plain]:
    class Raises(Plain):
        def _update(self, value: Any) -> None:
            raise error

    return Raises


class UnprintableError(Exception):
    def __str__(self) -> NoReturn:
        raise RuntimeError("no words")


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (SystemExit(0), "SystemExit: 0"),
        (UnprintableError(), "UnprintableError"),
        (ValueError("half a character: \udcff"), "ValueError: half a character"),
        (ValueError("two\nlines\x00"), "ValueError: two lines"),
        (ExceptionGroup("several", [ValueError("one"), KeyError("two")]), "ExceptionGroup: several"),
        (GeneratorExit(), "GeneratorExit"),
        (KeyboardInterrupt(), "KeyboardInterrupt"),
        (BaseException("odd"), "BaseException: odd"),
        (MemoryError(), "MemoryError"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_exceptions_of_every_sort_are_recorded(error: BaseException, said: str, tmp_path: Path) -> None:
    summary = simulate({"robot": Team({"bad": raising(error)})}, log=tmp_path / "run.mcap")
    event = failure(tmp_path / "run.mcap")
    assert said in event.data["problem"]
    assert type(error).__name__ in event.data["traceback"]
    assert present(summary.failure).encode()


def test_endless_recursion_is_a_fault_like_any_other(tmp_path: Path) -> None:
    class Recurses(Plain):
        def _compute(self) -> Any:
            return self._compute()

    simulate({"robot": Team({"bad": Recurses})}, log=tmp_path / "run.mcap")
    assert "RecursionError" in failure(tmp_path / "run.mcap").data["problem"]


BASES = [KeyboardInterrupt, SystemExit, GeneratorExit, type("OwnError", (BaseException,), {})]


PLACES = ("_compute", "_update", "initialise_component", "subscriber", "group", "_async_compute", "close")
RAISED = [
    (mode, kind, where)
    for mode in ("synchronous", "asynchronous")
    for kind in BASES
    # Nobody awaits anything in the synchronous mode, and GeneratorExit is how coroutines are given up.
    for where in (PLACES[:5] if mode == "synchronous" else PLACES[:6] if kind is GeneratorExit else PLACES)
]


@pytest.mark.parametrize(("mode", "kind", "where"), RAISED)
def test_an_exception_anywhere_in_a_component_is_its_own_failure(
    mode: Mode, kind: type[BaseException], where: str, tmp_path: Path
) -> None:
    """Only a signal interrupts a run."""

    class Bad(Plain):
        def initialise_component(self, *arguments: Any) -> None:
            super().initialise_component(*arguments)
            if where == "initialise_component":
                raise kind
            if where == "subscriber":
                self.subscribe("tick", self._on_tick)

        def _on_tick(self, event: Event) -> None:
            raise kind

        def _compute(self) -> None:
            if where == "_compute":
                raise kind

        def _update(self, value: Any) -> None:
            if where == "_update":
                raise kind
            self.emit("tick")

    class Awaits(Bad):
        async def _async_compute(self) -> None:
            if where == "_async_compute":
                raise kind
            try:
                await self.sleep(1000.0)
            finally:
                raise kind

    class Group(GroupComponent):
        def _compute(self) -> None:
            raise kind

        def _update(self, value: Any) -> None:
            pass

    bad: Any = {"group": Group, "_async_compute": Awaits, "close": Awaits}.get(where, Bad)
    summary = simulate({"robot": Team({"bad": bad})}, log=tmp_path / "run.mcap", options=RunOptions(mode=mode))
    if where == "close":  # the run is over by then
        assert summary.status == "finished"
        events = [event for event in open_log(tmp_path / "run.mcap").events() if event.name == "failed"]
        assert [event.source for event in events] == ["agents.robot.bad"]
        assert kind.__name__ in events[0].text
        return
    assert summary.status == "failed"
    event = failure(tmp_path / "run.mcap")
    assert event.source == "agents.robot.bad"
    assert kind.__name__ in event.data["problem"]


@pytest.mark.parametrize("kind", BASES)
def test_an_exception_in_a_world_is_its_own_failure(kind: type[BaseException], tmp_path: Path) -> None:
    class Breaks(KinematicEnvironment):
        def step(self) -> None:
            raise kind

    summary = simulate({"robot": Team()}, log=tmp_path / "run.mcap", environment=Breaks())
    assert summary.status == "failed"
    assert failure(tmp_path / "run.mcap").source == "environment"


@pytest.mark.parametrize("name", ["started", "initialised", "iterating", "stepped", "contact", "finished", "*"])
def test_an_outside_subscriber_that_raises_fails_the_run_at_any_event(name: str, tmp_path: Path) -> None:
    ready = simulation({"robot": Team({"plain": Plain}, count=2, entity=BODY)})

    def listener(event: Event) -> None:
        raise TroubleError("on purpose")

    ready.events.subscribe(name, listener)
    summary = execute(ready, 3, tmp_path / "run.mcap")
    assert summary.status == "failed"
    event = failure(tmp_path / "run.mcap")
    assert "listener" in event.data["problem"]
    assert "TroubleError: on purpose" in event.data["problem"]
    assert "listener" in event.data["traceback"]


def test_without_a_log_a_fault_is_still_announced() -> None:
    summary = simulate({"robot": Team({"bad": raising(TroubleError("on purpose"))})})
    assert summary.status == "failed"
    assert summary.failure == "agents.robot.bad (test.bad) failed at 0 s: TroubleError: on purpose"


def test_records_before_the_fault_are_kept(tmp_path: Path) -> None:
    late = type("Faulty", (Faulty,), {"at": 5 * STEP})
    simulate({"robot": Team({"bad": late})}, steps=9, log=tmp_path / "run.mcap")
    series = open_log(tmp_path / "run.mcap").series("robot", "world")
    assert series.times.tolist() == [step * STEP for step in range(5)]


SCENARIO = """
symaware: 1
name: fault
run: {{duration: 1.0}}
environment: {environment}
agents:
  robot:
    count: 2
    model: {{use: single-integrator}}
    components: {{see: {{use: perception.self}}, steer: {{use: doubles.fault, with: {fault}}}}}
"""
SOUND = {"use": "kinematic"}


@pytest.mark.parametrize(
    ("environment", "fault", "source", "said"),
    [
        (SOUND, {"where": "compute", "at": 0.3, "agent": "robot.1"}, "agents.robot.1.steer (doubles.fault)", "0.3 s"),
        (SOUND, {"where": "update"}, "agents.robot.0.steer (doubles.fault)", "0 s"),
        (SOUND, {"where": "initialise"}, "agents.robot.0.steer (doubles.fault)", "0 s"),
        (SOUND, {"where": "subscriber", "at": 0.3}, "agents.robot.0.steer (doubles.fault)", "0.3 s"),
        (SOUND, {"where": "exit"}, "agents.robot.0.steer (doubles.fault)", "SystemExit"),
        (SOUND, {"where": "unprintable"}, "agents.robot.0.steer (doubles.fault)", "UnprintableError"),
        (SOUND, {"value": "nan", "into": "control"}, "agents.robot.0.steer (doubles.fault)", "control input is not"),
        (SOUND, {"value": "-inf", "into": "state"}, "agents.robot.0.steer (doubles.fault)", "its state is not finite"),
        *(
            ({"use": "doubles.faulty-world", "with": {"where": where}}, {"at": 9}, "environment (doubles.fault", "the")
            for where in ("step", "state", "snapshot", "contacts", "nan")
        ),
    ],
)
def test_the_command_names_the_failed_component_and_the_time_and_exits_1(
    environment: Mapping[str, Any],
    fault: dict[str, Any],
    source: str,
    said: str,
    command: Command,
    doubles: Path,
    tmp_path: Path,
) -> None:
    (tmp_path / "fault.yaml").write_text(SCENARIO.format(environment=json.dumps(environment), fault=json.dumps(fault)))
    done = command("run", "fault.yaml")
    assert done.returncode == 1
    assert source in done.stderr
    assert said in done.stderr
    assert failure(tmp_path / "fault.mcap").source == source.partition(" ")[0]


def test_the_traceback_is_shown_on_demand_and_also_in_json(process: Command, doubles: Path, tmp_path: Path) -> None:
    (tmp_path / "fault.yaml").write_text(SCENARIO.format(environment=json.dumps(SOUND), fault="{}"))
    done = process("run", "fault.yaml", "--json")
    assert (done.returncode, done.stderr) == (1, "")
    summary = json.loads(done.stdout)
    assert summary["status"] == "failed"
    assert "agents.robot.0.steer (doubles.fault) failed at 0 s" in summary["failure"]
    shown = process("log", "events", "fault.mcap", encoding="utf-8")
    assert shown.returncode == 0
    assert "ZeroDivisionError: a fault on purpose \\udcff \N{SNOWMAN}" in shown.stdout
    assert "symaware_doubles.py" in shown.stdout
