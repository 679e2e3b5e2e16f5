"""Every event is fired in both modes, can be subscribed to, and is in the log if one wants it there."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import pytest
from simulating import STEP, Team, execute, present, simulation

from symaware_cli import (
    CommunicationReceiver,
    CommunicationSender,
    Component,
    Event,
    GroupComponent,
    Log,
    Message,
    open_log,
)
from symaware_cli.api.scenario import Mode
from symaware_cli.core.event import CHANNELS, RECURRING
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.run import run
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.engine.runtime.timing import Timing, Trigger
from symaware_cli.log.manifest import manifest_of
from symaware_cli.log.recorder import EventKinds, Recorder
from symaware_cli.log.writer import LogWriter
from symaware_cli.world.probability_distribution import always

MODES = pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])


class Idle(Component):
    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        pass


class Together(GroupComponent):
    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        pass


class Awaits(Idle):
    async def _async_compute(self) -> None:
        return None


class Tells(CommunicationSender):
    def _compute(self) -> list[Message]:
        return [Message("a.0", "a.1", {"x": 1})]


class Hears(CommunicationReceiver):
    def _update(self, value: Sequence[Message]) -> None:
        pass


def ready() -> Simulation:
    return simulation({"a": Team({"idle": Idle, "group": Together, "await": Awaits, "tell": Tells, "hear": Hears}, 2)})


@MODES
def test_all_that_recurs_is_fired_in_its_order(mode: Mode) -> None:
    told = []
    prepared = ready()
    for name in sorted(RECURRING):
        prepared.events.subscribe(name, lambda event: told.append((event.time // STEP, event.name, event.source)))
    execute(prepared, 2, options=RunOptions(mode=mode))
    turn = ["computing", "computed", "updating", "updated"]
    assert [name for _, name, source in told if source == "agents.a.1.idle"] == 2 * turn
    assert [name for _, name, source in told if source == "agents.a.group"] == [
        "initialising",
        "initialised",
        *turn,
        *turn,
    ]
    assert [name for _, name, source in told if source == "agents.a.0.await"] == 2 * turn
    assert [(time, name) for time, name, source in told if source == "run"] == [
        (time, name) for time in (0, 1) for name in ("iterating", "iterated")
    ]
    assert [(time, name) for time, name, source in told if source == "environment"] == [
        (0, "stepping"),
        (1, "stepped"),
        (1, "stepping"),
        (2, "stepped"),
    ]
    # Both senders send to the second agent at each step; what was sent at the first is there at the second.
    assert Counter(name for _, name, _ in told if name in ("sending", "sent", "received")) == {
        "sending": 4,
        "sent": 4,
        "received": 2,
    }
    assert [(time, source) for time, name, source in told if name == "received"] == 2 * [(1, "agents.a.1")]


def logged(path: Path, kinds: EventKinds, mode: Mode = "asynchronous", steps: int = 3) -> Log:
    prepared = ready()
    with LogWriter(path) as writer:
        content = manifest_of(
            name="events",
            seed=1,
            mode=mode,
            steps=steps,
            environment=prepared.environment,
            groups=prepared.groups,
            uses={"a": {"model": "test", "components": {}}},
            indexed={"a": True},
        )
        writer.attach("manifest.json", "application/json", content)
        recorder = Recorder(writer, prepared.environment, prepared.groups, events=kinds)
        run(prepared, steps, recorder, options=RunOptions(mode=mode))
    return open_log(path)


@MODES
def test_events_that_recur_are_recorded_in_columns_if_one_asks_for_all(mode: Mode, tmp_path: Path) -> None:
    log = logged(tmp_path / "all.mcap", "all", mode)
    found = []
    for message in log.messages(["/events/recurring"]):
        content = message.decode()
        names = [content.names[number] for number in content.name]
        sources = [content.sources[number] for number in content.source]
        found += [(message.time // STEP, *pair) for pair in zip(names, sources, strict=True)]
    assert [(time, name) for time, name, source in found if source == "agents.a.0.idle"] == [
        (time, name) for time in range(3) for name in ("computing", "computed", "updating", "updated")
    ]
    assert {name for _, name, _ in found} == RECURRING - CHANNELS - {"dropped", "adding", "removing"}
    assert [message.time // STEP for message in log.messages(["/events/recurring"])] == [0, 1, 2, 3]
    assert [event.name for event in log.events()] == ["started", "finished"]


def test_or_only_those_that_do_not_recur_or_only_the_last(tmp_path: Path) -> None:
    notable, none = (logged(tmp_path / f"{kinds}.mcap", kinds) for kinds in ("notable", "none"))
    assert "/events/recurring" not in notable.channels
    assert [event.name for event in notable.events()] == ["started", "finished"]
    assert [event.name for event in none.events()] == ["finished"]


@MODES
def test_subscribers_may_subscribe_and_cancel_and_trigger_while_an_event_fires(mode: Mode) -> None:
    told = []
    prepared = ready()
    bus = prepared.events

    def first(event: Event) -> None:
        told.append("first")
        subscription.cancel()
        bus.subscribe("updated", lambda event: told.append("second"), "agents.a.0.idle")

    subscription = bus.subscribe("updated", first, "agents.a.0.idle")
    execute(prepared, 3, options=RunOptions(mode=mode))
    assert told == ["first", "second", "second"]


@MODES
def test_a_subscriber_that_raises_ends_the_run_after_the_other_subscribers_are_called(mode: Mode) -> None:
    told = []
    prepared = ready()

    def fails(event: Event) -> None:
        raise ZeroDivisionError("on purpose")

    prepared.events.subscribe("stepped", fails)
    prepared.events.subscribe("stepped", lambda event: told.append(event.time))
    summary = execute(prepared, 3, options=RunOptions(mode=mode))
    assert summary.status == "failed"
    assert "ZeroDivisionError: on purpose" in present(summary.failure)
    assert told == [STEP]


@MODES
def test_components_may_be_triggered_by_python_too(mode: Mode) -> None:
    from symaware_cli import Event
    from symaware_cli.engine.runtime.timing import Trigger

    turns = []

    class Notes(Idle):
        def _update(self, value: Any) -> None:
            turns.append(self.now // STEP)

    prepared = simulation({"a": Team({"it": Notes}, timings={"it": Timing(trigger=Trigger("go", source="outside"))})})

    def on_step(event: Event) -> None:
        if event.time == 2 * STEP:
            prepared.events.fire(Event("go", "outside", event.time))

    prepared.events.subscribe("stepped", on_step)
    execute(prepared, 5, options=RunOptions(mode=mode))
    assert turns == [2]


@MODES
def test_an_external_input_fires_an_event_with_it(mode: Mode) -> None:
    class Asks(Idle):
        def _compute(self) -> None:
            assert self.external_input(lambda: {"speed": 2.0}) == {"speed": 2.0}

    ready = simulation({"a": Team({"ask": Asks})})
    found: list[Event] = []
    ready.events.subscribe("external-input", found.append)
    execute(ready, 2, options=RunOptions(mode=mode))
    assert {event.source for event in found} == {"agents.a.ask"}
    assert [event.data for event in found] == [{"answer": {"speed": 2.0}}] * len(found)


def test_an_event_knows_its_agent_and_what_was_computed() -> None:
    seen = []

    class Doubles(Component):
        def _compute(self) -> str:
            return self.agent.id

        def _update(self, value: str) -> None:
            self.emit("told")

    class Whole(GroupComponent):
        def _compute(self) -> int:
            return len(self.group)

        def _update(self, value: int) -> None:
            self.emit_for(1, "told")

    ready = simulation({"a": Team({"each": Doubles, "whole": Whole}, count=2)})
    for name in ("computing", "computed", "updating", "updated", "told"):
        ready.events.subscribe(name, lambda event: seen.append((event.name, event.source, event.agent, event.value)))
    run(ready, 1)
    assert seen[:5] == [
        ("computing", "agents.a.0.each", "a.0", None),
        ("computed", "agents.a.0.each", "a.0", "a.0"),
        ("updating", "agents.a.0.each", "a.0", "a.0"),
        ("told", "agents.a.0.each", "a.0", None),
        ("updated", "agents.a.0.each", "a.0", "a.0"),
    ]
    assert seen[10:] == [
        ("computing", "agents.a.whole", None, None),
        ("computed", "agents.a.whole", None, 2),
        ("updating", "agents.a.whole", None, 2),
        ("told", "agents.a.1.whole", "a.1", None),
        ("updated", "agents.a.whole", None, 2),
    ]


@pytest.mark.parametrize("latency", [0.0, 0.02])
def test_events_of_turns_that_take_time_know_as_much(latency: float) -> None:
    seen = []

    class Slow(Component):
        async def _async_compute(self) -> str:
            await self.sleep(0.01)
            return "waited"

        def _compute(self) -> str:
            return "computed"

        def _update(self, value: str) -> None:
            pass

    cases: list[tuple[Mode, str]] = [("synchronous", "computed"), ("asynchronous", "waited")]
    for mode, value in cases:
        timing = Timing(latency=always(latency))
        ready = simulation({"a": Team({"slow": Slow}, timings={"slow": timing})})
        ready.events.subscribe("computed", lambda event: seen.append((event.agent, event.value)))
        run(ready, 3, options=RunOptions(mode=mode))
        assert seen[-1] == ("a", value)


@pytest.mark.parametrize("in_process", [False, True])
def test_a_group_component_knows_whom_the_events_concern_that_triggered_its_turn(in_process: bool) -> None:
    seen = []
    timing = Timing(trigger=Trigger("told"), period=2 * STEP, in_process=in_process)
    team = Team({"tells": Telling, "hears": Hearing}, count=4, timings={"hears": timing})
    ready = simulation({"a": team})
    ready.events.subscribe("heard", lambda event: seen.append((event.time // STEP, event.data["rows"])))
    summary = run(ready, 3)
    assert summary.status == "finished", summary.failure
    assert seen == [(0, None), (1, [1, 3]), (2, None), (2, [0])]


class Telling(GroupComponent):
    """Speaks for some agents at some steps."""

    events: ClassVar = {"told": ""}

    def _compute(self) -> list[int]:
        return {1: [3, 1], 2: [0]}.get(self.now // STEP, [])

    def _update(self, value: Sequence[int]) -> None:
        for row in value:
            self.emit_for(row, "told")


class Hearing(GroupComponent):
    """Says for whom it takes its turn."""

    events: ClassVar = {"heard": ""}

    def _compute(self) -> list[int] | None:
        return None if self.triggered is None else list(self.triggered)

    def _update(self, value: Sequence[int] | None) -> None:
        self.emit("heard", rows=value)


def test_the_end_of_an_agent_is_its_own() -> None:
    seen = []

    class Fails(Component):
        def _compute(self) -> None:
            raise ValueError("no")

        def _update(self, value: Any) -> None:
            pass

    timing = Timing(on_failure="isolate")
    ready = simulation({"a": Team({"fails": Fails}, count=2, timings={"fails": timing})})
    ready.events.subscribe("*", lambda event: seen.append((event.name, event.agent)))
    run(ready, 1)
    assert seen[:3] == [("started", None), ("failed", "a.0"), ("terminated", "a.0")]
