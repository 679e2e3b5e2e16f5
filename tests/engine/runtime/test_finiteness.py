"""Values that are not finite: the component that writes them fails in the same turn, before anything reads them."""

from collections.abc import Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
from checkout import CHECKOUT
from simulating import STEP, Team, execute, made, present, simulate, simulation, untyped

import symaware_cli as sa
from symaware_cli.awareness.part import Part
from symaware_cli.core import (
    CommunicationReceiver,
    Component,
    GroupComponent,
    Message,
    Quantity,
    Signal,
    TimeSeries,
)
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.timing import Timing
from symaware_cli.log.reader import open_log
from symaware_cli.world.probability_distribution import always

COLUMNS = (Quantity("one", "m"), Quantity("other", "m"))
ATTENTION = Part("attention", "vector", COLUMNS)
FORECAST = Part("forecast", "series", COLUMNS)
VECTOR, SERIES, TABLE = (Signal(name, name, COLUMNS) for name in ("vector", "series", "table"))
SIGNALS = (VECTOR, SERIES, TABLE)

#: Everything that a component can write: what `write` calls it, and what the failure calls it.
WRITTEN = {
    "control": "control input",
    "state": "state",
    "intent": "intent",
    "uncertainty": "uncertainty",
    "risk": "risk",
    "attention": "attention",
    "forecast": "forecast",
    "write.vector": "signal `write.vector`",
    "write.series": "signal `write.series`",
    "write.table": "signal `write.table`",
}
SERIAL = {"intent", "uncertainty", "risk", "forecast", "write.series"}
BAD = 2 * STEP


class Writer(Component):
    """Writes one quantity of its agent; not finite at one time, for the second agent."""

    parts: ClassVar[Sequence[Part]] = (ATTENTION, FORECAST)
    signals: ClassVar[Sequence[Signal]] = SIGNALS
    what: ClassVar = "risk"
    value: ClassVar = float("nan")

    def _compute(self) -> Any:
        is_bad = self._agent.row == 1 and self.now == BAD
        return [0.25, self.value if is_bad else 0.5]

    def _update(self, value: Any) -> None:
        agent = self._agent
        if self.what == "control":
            agent.model.control_input = value
        elif self.what in SERIAL:
            agent.self_awareness[self.what] = TimeSeries({self.time: value})
        elif self.what.endswith("table"):
            agent.self_awareness[self.what] = [[0.0, 1.0], value]
        else:
            agent.self_awareness[self.what] = value


class Waiter(Writer):
    """The same as a coroutine that waits within its turn."""

    async def _async_compute(self) -> Any:
        value = self._compute()
        await self.sleep(0.01)
        return value


class Writers(GroupComponent):
    """The same for the whole group."""

    parts: ClassVar[Sequence[Part]] = (ATTENTION, FORECAST)
    signals: ClassVar[Sequence[Signal]] = SIGNALS
    what: ClassVar = "risk"
    value: ClassVar = float("nan")

    def _compute(self) -> Any:
        values = np.tile([0.25, 0.5], (3, 1))
        if self.now == BAD:
            values[1, 1] = self.value
        return values

    def _update(self, value: Any) -> None:
        awareness = self._group.awareness
        if self.what == "control":
            self._group.control_input = value
        elif self.what in SERIAL:
            awareness[self.what].set([self.now], value[:, None])
        elif self.what.endswith("table"):
            awareness[self.what] = [[[0.0, 1.0], each] for each in value]
        else:
            awareness[self.what] = value


class Deferring(Writers):
    """The same, computed when it is first read."""

    def _update(self, value: Any) -> None:
        now = self.now
        self._group.awareness[self.what].defer(lambda: ([now], value[:, None]))


class Remote(Writer):
    """The same, with its computation in a worker process."""

    class Parameters(sa.Parameters):
        """What it writes."""

        what: str = "risk"

    def _update(self, value: Any) -> None:
        vars(self)["what"] = self.parameters.what
        super()._update(value)


class Reader(GroupComponent):
    """Reads everything that there is after each turn of the writer."""

    def initialise_component(self, group: Any) -> None:
        super().initialise_component(group)
        self.read: list[int] = []

    def _compute(self) -> None:
        for name in self._group.awareness.columns:
            values = self._group.awareness[name]
            for row in range(len(self._group)):
                values.row(row) if hasattr(values, "row") else values[row]
        self.read.append(self.now)

    def _update(self, value: None) -> None:
        pass


class Teller(Component):
    """Sends the awareness of its agent to everybody."""

    def _compute(self) -> Message:
        return Message(self._agent.id, "*", {"awareness": self._agent.self_awareness.replaced()})

    def _update(self, value: Message) -> None:
        self.send(value)


class Hearer(CommunicationReceiver):
    """Keeps what it heard."""

    heard: ClassVar[list[Any]] = []

    def _update(self, value: Any) -> None:
        Hearer.heard += [message.payload["awareness"] for message in value]


def team(kind: type, what: str, value: float = float("nan"), timing: Timing | None = None) -> Team:
    class Kind(kind):  # type: ignore[misc]
        pass

    Kind.what, Kind.value = what, value
    return Team(
        {"hear": Hearer, "write": Kind, "read": Reader, "tell": Teller},
        count=3,
        timings={"write": timing} if timing else {},
    )


def groups(of: Team) -> Any:
    """A simulation of the team, whose groups have the declared parts."""
    original = Team.group

    class Declared(Team):
        def group(self, name: str) -> Any:
            group = original(self, name)
            for part in (ATTENTION, FORECAST):
                group.awareness.parts[part.name] = part
                group.awareness.columns[part.name] = part.column(len(group))
            return group

    declared = Declared(**vars(of))
    return simulation({"a": declared})


KINDS: Mapping[str, tuple[type, RunOptions, Timing | None, int]] = {
    "single": (Writer, RunOptions(), None, BAD),
    "single, asynchronous": (Writer, RunOptions(mode="asynchronous"), None, BAD),
    "single, with a latency": (Writer, RunOptions(), Timing(latency=always(STEP / 1e9)), BAD + STEP),
    "coroutine": (Waiter, RunOptions(mode="asynchronous"), None, BAD + 10_000_000),
    "group": (Writers, RunOptions(), None, BAD),
    "group, asynchronous": (Writers, RunOptions(mode="asynchronous"), None, BAD),
    "group, with a latency": (Writers, RunOptions(), Timing(latency=always(STEP / 1e9)), BAD + STEP),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("what", WRITTEN)
@pytest.mark.parametrize("value", [float("nan"), float("-inf")])
def test_a_value_that_is_not_finite_is_read_by_nobody(kind: str, what: str, value: float, tmp_path: Path) -> None:
    writer, options, timing, time = KINDS[kind]
    Hearer.heard.clear()
    ready = groups(team(writer, what, value, timing))
    summary = execute(ready, 6, tmp_path / "run.mcap", options)
    assert summary.status == "failed"
    log = open_log(tmp_path / "run.mcap")
    failed = list(log.events())[-1]
    assert (failed.name, failed.source, failed.time) == ("failed", "agents.a.1.write", time)
    assert f"its {WRITTEN[what]} is not finite" in present(summary.failure)
    reader = untyped(ready.entries[2].components[0])
    assert reader.read == [each for each in range(0, time + 1, STEP) if each < time]
    for message in log.messages():
        if message.channel.topic.startswith("/agents") and what.split(".")[-1] in message.channel.topic:
            assert message.time < time
    for vector in Hearer.heard:
        for _, heard in vector.items():  # noqa: PERF102 (not a mapping)
            values = heard.values if isinstance(heard, TimeSeries) else heard
            assert np.isfinite(values).all() or np.isnan(values).all(), "nothing, or what was not written yet"


@pytest.mark.parametrize(
    "what", ["risk", *(pytest.param(each, marks=pytest.mark.slow) for each in WRITTEN if each != "risk")]
)
def test_a_value_computed_in_a_worker_process_is_checked_as_well(what: str, tmp_path: Path) -> None:
    timing = Timing(in_process=True)
    remote = Team({"write": lambda: made(Remote, what=what), "read": Reader}, count=3, timings={"write": timing})
    summary = execute(groups(remote), 6, tmp_path / "run.mcap", RunOptions(workers=1))
    assert summary.status == "failed"
    failed = list(open_log(tmp_path / "run.mcap").events())[-1]
    assert (failed.source, failed.time) == ("agents.a.1.write", BAD)
    assert f"its {WRITTEN[what]} is not finite" in present(summary.failure)


@pytest.mark.parametrize("what", ["risk", "forecast", "write.series"])
def test_a_deferred_series_that_is_not_finite_fails_the_component_that_deferred_it(what: str, tmp_path: Path) -> None:
    ready = groups(team(Deferring, what))
    summary = execute(ready, 6, tmp_path / "run.mcap")
    assert summary.status == "failed"
    failed = list(open_log(tmp_path / "run.mcap").events())[-1]
    assert (failed.source, failed.time) == ("agents.a.write", BAD)
    assert f"its {WRITTEN[what]} is not finite" in present(summary.failure)


@pytest.mark.parametrize("kind", ["single", "group"])
@pytest.mark.parametrize("what", WRITTEN)
def test_an_agent_that_is_isolated_keeps_its_last_finite_values(kind: str, what: str, tmp_path: Path) -> None:
    timing = Timing(on_failure="isolate", coast="last")
    ready = groups(team(KINDS[kind][0], what, timing=timing))
    summary = execute(ready, 6, tmp_path / "run.mcap")
    assert (summary.status, summary.failures) == ("finished", 1)
    assert [each.source for each in open_log(tmp_path / "run.mcap").events() if each.name == "terminated"] == [
        "agents.a.1"
    ]
    (group,) = ready.groups
    column = group.control_column if what == "control" else group.awareness.columns[what]
    value = column.row(1)
    if isinstance(value, TimeSeries):
        assert value.times.tolist() == [BAD - STEP]
        value = value.values
    assert np.isfinite(value).all()
    assert np.ravel(value)[-1] == 0.5


@pytest.mark.parametrize("declared", ["nan", "infinity"])
def test_a_signal_may_declare_what_nan_or_infinity_means(declared: Literal["nan", "infinity"]) -> None:
    value = float("nan") if declared == "nan" else float("inf")
    other = float("inf") if declared == "nan" else float("nan")
    meaning: dict[str, Any] = {declared: "nothing there"}
    signal = Signal("vector", "vector", COLUMNS, **meaning)

    def summary(written: float) -> str:
        class Says(Writer):
            parts: ClassVar[Sequence[Part]] = ()
            signals: ClassVar[Sequence[Signal]] = (signal,)

            def _update(self, value: Any) -> None:
                self.record(signal, value)

        Says.value = written
        return simulate({"a": Team({"write": Says}, count=3)}, 4).status

    assert summary(value) == "finished"
    assert summary(other) == "failed"


def test_a_component_that_is_initialised_with_a_value_that_is_not_finite_fails() -> None:
    class Begins(Writer):
        parts: ClassVar[Sequence[Part]] = ()
        signals: ClassVar[Sequence[Signal]] = ()

        def initialise_component(self, *arguments: Any) -> None:
            super().initialise_component(*arguments)
            self._agent.self_awareness.risk = TimeSeries({0.0: [float("nan")]})

    summary = simulate({"a": Team({"write": Begins}, count=2)}, 4)
    assert (summary.status, summary.steps) == ("failed", 0)
    assert "agents.a.0.write" in present(summary.failure)
    assert "its risk is not finite: [nan] at 0 s" in present(summary.failure)


@pytest.mark.parametrize("how", ["belief", "message"])
def test_neither_a_belief_about_another_nor_a_message_takes_a_risk_that_is_not_finite(how: str) -> None:
    class Believes(Component):
        def _compute(self) -> TimeSeries:
            return TimeSeries({self.time: [float("nan")]})

        def _update(self, value: TimeSeries) -> None:
            agent = self._agent
            if how == "belief":
                agent.awareness_database.set_part("risk", "a.1", value)
            else:
                self.send(Message(agent.id, "*", {"awareness": agent.self_awareness.replaced(risk=value)}))

    summary = simulate({"a": Team({"believe": Believes}, count=2)}, 4)
    assert summary.status == "failed"
    assert "is not finite" in present(summary.failure)
    assert "agents.a.0.believe" in present(summary.failure)


def test_every_declared_exception_is_documented() -> None:
    text = (CHECKOUT / "docs" / "time.md").read_text(encoding="utf-8")
    components = [each for each in entry_points(group="symaware.components") if each.value.startswith("symaware_cli.")]
    declared = [
        (each.name, signal)
        for each in components
        for signal in (*each.load().signals, *each.load().parts)
        if signal.nan or signal.infinity
    ]
    assert declared
    for name, signal in declared:
        (line, *_) = [line for line in text.splitlines() if f"`{name}`" in line and (signal.nan or "") in line]
        for word, meaning in (("NaN", signal.nan), ("infinite", signal.infinity)):
            assert meaning is None or f"{word}: {meaning}" in line
