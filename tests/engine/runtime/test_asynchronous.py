"""The asynchronous mode: who takes a turn when, what is seen, and what waits for what."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT
from faulting import fault
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from simulating import STEP, Team, execute, present, simulate, simulation, untyped

from symaware_cli import (
    Agent,
    AgentGroup,
    AgentSelection,
    AwarenessDatabase,
    CommunicationReceiver,
    CommunicationSender,
    Component,
    Controller,
    GroupComponent,
    Message,
    TimeSeries,
    open_log,
)
from symaware_cli.engine.faults.stop import Stop
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.run_summary import RunSummary
from symaware_cli.engine.runtime.timing import Overrun, Timing, Trigger
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute as execute_built
from symaware_cli.log.digest import digest
from symaware_cli.specification.expression import Expression
from symaware_cli.testing import assert_repeatable
from symaware_cli.world import ProbabilityDistribution
from symaware_cli.world.probability_distribution import always

ASYNCHRONOUS = RunOptions(mode="asynchronous")
MILLISECOND = 1_000_000
SCENARIOS = sorted(
    path
    for path in (CHECKOUT / "scenarios").rglob("*")
    if path.suffix in (".yaml", ".toml") and "symaware" in path.read_text().split("agents")[0]
)


def noting(turns: list[Any], base: type[Component] = Component) -> type[Component]:
    """A kind of component that notes its turns: when and who."""

    class Notes(base):  # type: ignore[misc, valid-type] # any class of components
        def _compute(self) -> int:
            return int(self.now)

        def _update(self, value: int) -> None:
            turns.append((self.now, self.path.removeprefix("agents.")))

    return Notes


def turns_of(
    timing: Timing, steps: int = 4, count: int | None = None, options: RunOptions = ASYNCHRONOUS, **more: Any
) -> list[float]:
    """When a component takes its turns, in ms."""
    turns: list[Any] = []
    simulate({"a": Team({"it": noting(turns)}, count=count, timings={"it": timing})}, steps, options=options, **more)
    return [time / MILLISECOND for time, _ in turns]


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda path: path.name)
def test_every_example_gives_the_same_in_both_modes_where_its_components_have_the_period_of_the_world(
    scenario: Path, tmp_path: Path
) -> None:
    steady = all(
        component.period is None and component.trigger is None and component.latency == 0
        for agents in build(scenario).document.agents.values()
        for component in agents.components.values()
    )
    if not steady:
        pytest.skip("its components have periods of their own")
    if build(scenario).document.topology is not None:
        pytest.skip("its messages arrive between steps, which only the asynchronous mode tells apart")
    logs = []
    for mode in ("synchronous", "asynchronous"):
        built = build(scenario, ["run.duration=1.5", f"run.mode={mode}"])
        logs.append(tmp_path / f"{mode}.mcap")
        with built.simulation.environment:
            execute_built(built, logs[-1])
    one, other = (digest(open_log(log)) for log in logs)
    assert set(one.differences(other)) == {"manifest.json", "resolved.yaml"}


def test_turns_come_at_exact_multiples_of_the_period_for_any_step_of_the_world() -> None:
    assert turns_of(Timing(period=20 * MILLISECOND)) == [0, 20, 40, 60, 80, 100, 120, 140, 160, 180]
    assert turns_of(Timing(period=70 * MILLISECOND, offset=5 * MILLISECOND)) == [5, 75, 145]
    assert turns_of(Timing()) == [0, 50, 100, 150]
    assert turns_of(Timing(offset=10 * MILLISECOND)) == [10, 60, 110, 160]


def test_the_same_timing_in_the_synchronous_mode_is_that_of_the_steps() -> None:
    synchronous = RunOptions()
    assert turns_of(Timing(period=20 * MILLISECOND), options=synchronous) == [0, 50, 100, 150]
    assert turns_of(Timing(period=70 * MILLISECOND, offset=5 * MILLISECOND), options=synchronous) == [50, 100, 150]
    assert turns_of(Timing(period=100 * MILLISECOND), options=synchronous) == [0, 100]
    assert turns_of(Timing(period=1), options=synchronous) == [0, 50, 100, 150]
    assert turns_of(Timing(period=0), options=synchronous) == [0, 50, 100, 150]


@settings(max_examples=30, deadline=None)
@given(
    period=st.integers(1_000_000, 200_000_000),
    offset=st.integers(0, 100_000_000),
    jitter=st.floats(0, 0.99),
    seed=st.integers(0, 99),
)
def test_there_are_as_many_turns_as_fit_and_none_drifts(period: int, offset: int, jitter: float, seed: int) -> None:
    late = int(jitter * period)
    timing = Timing(period=period, offset=offset, jitter=late)
    turns: list[Any] = []
    simulate({"a": Team({"it": noting(turns)}, timings={"it": timing})}, 6, options=ASYNCHRONOUS, seed=seed)
    end = 6 * STEP
    for number, (time, _) in enumerate(turns):
        nominal = offset + number * period
        assert nominal <= time <= nominal + late
    surely = len(range(offset, end - late, period))
    assert surely <= len(turns) <= len(range(offset, end, period))


def test_jitter_is_seeded_by_the_path_so_that_more_agents_change_nobody_elses() -> None:
    timing = Timing(period=30 * MILLISECOND, jitter=20 * MILLISECOND)

    def turns(count: int | None, seed: int = 7) -> list[tuple[int, str]]:
        found: list[Any] = []
        simulate({"a": Team({"it": noting(found)}, count, timings={"it": timing})}, options=ASYNCHRONOUS, seed=seed)
        return [each for each in found if each[1] == "0.it" or each[1] == "a.0.it"]

    assert turns(1) == turns(3)
    assert turns(1) != turns(1, seed=8)


def test_at_one_instant_turns_are_in_declared_order_however_they_are_due() -> None:
    turns: list[Any] = []
    kind = noting(turns)
    timings = {"one": Timing(period=25 * MILLISECOND), "three": Timing(period=10 * MILLISECOND, offset=0)}
    team = Team({"one": kind, "two": kind, "three": kind}, count=2, timings=timings)
    simulate({"a": team, "b": Team({"one": kind}, timings=timings)}, 2, options=ASYNCHRONOUS)
    order = ["a.0.one", "a.1.one", "a.0.two", "a.1.two", "a.0.three", "a.1.three", "b.one"]
    assert [who for time, who in turns if time == 0] == order
    assert [who for time, who in turns if time == STEP] == order
    assert turns == sorted(turns, key=lambda each: (each[0], order.index(each[1])))


class Drives(GroupComponent):
    """Drives faster at each of its turns."""

    def _compute(self) -> NDArray[np.float64]:
        return np.array([[1.0 + self.now / 1e9, 0.0]])

    def _update(self, value: NDArray[np.float64]) -> None:
        self.group.control_input = value


class Looks(GroupComponent):
    """Notes what it sees."""

    def initialise_component(self, group: AgentGroup) -> None:
        super().initialise_component(group)
        self.seen: list[Any] = []

    def _compute(self) -> None:
        world = self.environment.snapshot()
        self.seen.append((self.now / 1e9, world.time / 1e9, float(world.positions[0, 0])))

    def _update(self, value: Any) -> None:
        pass


def test_between_two_steps_the_world_is_seen_as_of_the_last_one_and_moves_under_the_input_at_its_step() -> None:
    team = Team(
        {"drive": Drives, "look": Looks},
        timings={name: Timing(period=20 * MILLISECOND) for name in ("drive", "look")},
    )
    ready = simulation({"a": team})
    execute(ready, 4, options=ASYNCHRONOUS)
    seen = untyped(ready.entries[1].components[0]).seen
    assert [time for time, _, _ in seen] == pytest.approx(np.arange(10) * 0.02)
    assert [world for _, world, _ in seen] == pytest.approx([0, 0, 0, 0.05, 0.05, 0.1, 0.1, 0.1, 0.15, 0.15])
    # The steps begin at 0, 50, 100 and 150 ms; the inputs in force are those of 0, 40, 100 and 140 ms.
    where = np.cumsum([0, 0.05 * 1.0, 0.05 * 1.04, 0.05 * 1.1])
    assert [place for _, _, place in seen] == pytest.approx([where[round(world / 0.05)] for _, world, _ in seen])
    assert ready.environment.state(ready.groups[0])[0, 0] == pytest.approx(where[-1] + 0.05 * 1.14)


def test_values_written_between_two_steps_are_recorded_at_their_instant(tmp_path: Path) -> None:
    team = Team({"drive": Drives}, timings={"drive": Timing(period=20 * MILLISECOND)})
    simulate({"a": team}, 2, tmp_path / "run.mcap", ASYNCHRONOUS)
    series = open_log(tmp_path / "run.mcap").series("a", "requested_control")
    assert series.times.tolist() == [time * MILLISECOND for time in (0, 20, 40, 60, 80)]
    world = open_log(tmp_path / "run.mcap").series("a", "world")
    assert world.times.tolist() == [0, STEP, 2 * STEP]


# Latency and overrun


class Slow(Component):
    """Notes when it computes and when that lands."""

    log: list[Any]

    def _compute(self) -> float:
        return self.now / MILLISECOND

    def _update(self, value: float) -> None:
        self.log.append((value, self.now / MILLISECOND))


def latent(
    timing: Timing, steps: int = 4, options: RunOptions = ASYNCHRONOUS
) -> tuple[list[tuple[float, float]], RunSummary]:
    kind = type("Slow", (Slow,), {"log": []})
    summary = simulate({"a": Team({"it": kind}, timings={"it": timing})}, steps, options=options)
    return untyped(kind).log, summary


def test_an_update_lands_a_latency_later_with_the_data_of_its_start() -> None:
    found, summary = latent(Timing(latency=always(0.03)))
    assert found == [(0, 30), (50, 80), (100, 130), (150, 180)]
    assert summary.overruns == 0
    # At step granularity, it lands at the next step.
    assert latent(Timing(latency=always(0.03)), options=RunOptions())[0] == [
        (0, 50),
        (50, 100),
        (100, 150),
    ]


def test_a_latency_of_exactly_one_period_lands_before_the_next_turn_begins() -> None:
    found, summary = latent(Timing(latency=always(0.05)))
    assert found == [(0, 50), (50, 100), (100, 150)]
    assert summary.overruns == 0


@pytest.mark.parametrize(
    ("overrun", "expected", "overruns"),
    [
        ("skip", [(0, 80), (100, 180), (200, 280)], 3),
        ("queue", [(0, 80), (80, 160), (160, 240)], 5),
    ],
)
def test_a_turn_that_is_due_too_early_is_skipped_or_queued(
    overrun: Overrun, expected: list[tuple[int, int]], overruns: int
) -> None:
    found, summary = latent(Timing(latency=always(0.08), overrun=overrun), steps=6)
    assert found == expected
    assert summary.overruns == overruns


def test_or_it_is_a_failure(tmp_path: Path) -> None:
    kind = type("Slow", (Slow,), {"log": []})
    timing = Timing(latency=always(0.08), overrun="fail")
    summary = simulate({"a": Team({"it": kind}, timings={"it": timing})}, 6, tmp_path / "run.mcap", ASYNCHRONOUS)
    assert summary.status == "failed"
    assert "a turn was due while the one before still computed" in present(summary.failure)
    names = [event.name for event in open_log(tmp_path / "run.mcap").events()]
    assert names == ["started", "overrun", "failed"]


@pytest.mark.parametrize(
    "duration", [ProbabilityDistribution(uniform=(0.01, 0.04)), ProbabilityDistribution(normal=(0.03, 0.02), least=0)]
)
def test_a_drawn_latency_is_seeded_and_never_negative(duration: ProbabilityDistribution) -> None:
    found, _ = latent(Timing(period=100 * MILLISECOND, latency=duration), steps=40)
    assert latent(Timing(period=100 * MILLISECOND, latency=duration), steps=40)[0] == found
    taken = [landed - begun for begun, landed in found]
    assert min(taken) >= 0
    assert len(set(taken)) > 10
    if duration.uniform:
        assert 10 <= min(taken) <= max(taken) <= 40


def test_turns_begin_at_the_same_instants_with_and_without_latency() -> None:
    """Jitter and latencies are drawn for different purposes."""
    timing = Timing(period=100 * MILLISECOND, jitter=40 * MILLISECOND)
    slow, quick = (
        latent(replace(timing, latency=each), steps=40)[0]
        for each in (ProbabilityDistribution(uniform=(0.01, 0.04)), always(0.0))
    )
    assert [begun for begun, _ in slow[:15]] == [begun for begun, _ in quick[:15]]
    late = [begun % 100 / 40 for begun, _ in slow[:15]]
    assert not np.allclose(late, [(landed - begun - 10) / 30 for begun, landed in slow[:15]], atol=1e-3)


# Triggers and conditions


class Rings(Component):
    """Fires `ring` at some instants."""

    at: tuple[int, ...] = (50,)

    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        if self.now / MILLISECOND in self.at:
            self.emit("ring")


def rung(
    trigger: Trigger, order: tuple[str, str], options: RunOptions = ASYNCHRONOUS, count: int | None = 2, **more: Any
) -> list[tuple[float, str]]:
    """The turns of a component with a trigger; `ring` is fired for the first agent only, at 50 and 80 ms."""
    turns: list[Any] = []

    class Quiet(Rings):
        at = (50, 80)

        def _update(self, value: Any) -> None:
            if self._agent.row == 0:
                super()._update(value)

    kinds: dict[str, type[Component]] = {"bell": Quiet, "it": noting(turns)}
    timings = {"bell": Timing(period=10 * MILLISECOND), "it": Timing(trigger=trigger, **more)}
    simulate({"a": Team({name: kinds[name] for name in order}, count, timings=timings)}, 4, options=options)
    return [(time / MILLISECOND, who) for time, who in turns]


@pytest.mark.parametrize("order", [("bell", "it"), ("it", "bell")])
def test_an_event_triggers_a_turn_of_the_same_agent_at_the_same_instant(order: tuple[str, str]) -> None:
    assert rung(Trigger("ring", component="bell"), order) == [(50, "a.0.it"), (80, "a.0.it")]
    assert rung(Trigger("ring"), order) == [(50, "a.0.it"), (80, "a.0.it")]


def test_an_event_of_somebody_else_triggers_everybody() -> None:
    found = rung(Trigger("ring", source="agents.a.0.*"), ("it", "bell"))
    assert found == [(time, f"a.{row}.it") for time in (50, 80) for row in (0, 1)]


def test_in_the_synchronous_mode_a_trigger_comes_in_its_place_or_in_the_next_step() -> None:
    # The bell takes a turn at each step, 50, 100 and so on: it rings at 50 only.
    assert rung(Trigger("ring"), ("bell", "it"), RunOptions()) == [(50, "a.0.it")]
    assert rung(Trigger("ring"), ("it", "bell"), RunOptions()) == [(100, "a.0.it")]


def test_a_trigger_may_come_besides_a_period() -> None:
    found = rung(Trigger("ring"), ("bell", "it"), period=60 * MILLISECOND, count=None)
    assert [time for time, _ in found] == [0, 50, 60, 80, 120, 180]


def test_a_turn_follows_the_event_that_caused_it_in_declared_order_or_in_another_round() -> None:
    turns = []

    class Chain(Component):
        def _compute(self) -> None:
            return None

        def _update(self, value: Any) -> None:
            turns.append(self.name)
            self.emit("done")

    timings = {
        "first": Timing(trigger=Trigger("done", component="last")),
        "last": Timing(period=1000 * MILLISECOND),
        "middle": Timing(trigger=Trigger("done", component="first")),
    }
    kinds = dict.fromkeys(("first", "last", "middle"), Chain)
    simulate({"a": Team(kinds, timings=timings)}, 1, options=ASYNCHRONOUS)
    assert turns == ["last", "first", "middle"]


def test_a_contact_triggers_the_agents_in_it() -> None:
    from symaware_cli import Entity

    turns: list[Any] = []
    body = Entity.model_validate({"shape": {"circle": {"radius": 0.3}}})

    class Approach(GroupComponent):
        def _compute(self) -> NDArray[np.float64]:
            return np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]])

        def _update(self, value: NDArray[np.float64]) -> None:
            self.group.control_input = value

    team = Team(
        {"go": Approach, "it": noting(turns)},
        count=3,
        state=[[0, 0], [1.0, 0], [9, 0]],
        entity=body,
        timings={"it": Timing(trigger=Trigger("contact", source="environment"))},
    )
    simulate({"a": team}, 12, options=ASYNCHRONOUS)
    assert [who for _, who in turns[:2]] == ["a.0.it", "a.1.it"]
    assert {who for _, who in turns} == {"a.0.it", "a.1.it"}


@pytest.mark.parametrize("options", [RunOptions(), ASYNCHRONOUS], ids=["synchronous", "asynchronous"])
def test_a_condition_leaves_turns_out(options: RunOptions) -> None:
    names = {"x", "time", "limit"}
    condition = Expression("x > limit and time < 0.3", names)
    turns: list[Any] = []
    team = Team(
        {"drive": Drives, "see": Sees, "it": noting(turns)},
        knowledge=[{"limit": 0.1}],
        timings={"it": Timing(condition=condition)},
    )
    simulate({"a": team}, 10, options=options)
    assert [time / MILLISECOND for time, _ in turns] == [100, 150, 200, 250]


@pytest.mark.parametrize("intent", [{}, {0.05: [1.0]}, {0.05: [1.0], 0.1: [2.0]}], ids=len)
def test_an_agent_has_an_intent_from_its_first_point_on(intent: dict[float, list[float]]) -> None:
    class Intends(Component):
        def _compute(self) -> TimeSeries:
            return TimeSeries(intent)

        def _update(self, value: TimeSeries) -> None:
            self._agent.self_awareness.intent = value

    turns: list[Any] = []
    condition = Expression("has_intent", {"has_intent"})
    simulate({"a": Team({"plan": Intends, "it": noting(turns)}, timings={"it": Timing(condition=condition)})}, 1)
    assert len(turns) == (1 if intent else 0)


@pytest.mark.parametrize("options", [RunOptions(), ASYNCHRONOUS], ids=["synchronous", "asynchronous"])
def test_the_condition_of_a_group_holds_if_it_holds_for_any_of_its_agents_that_take_part(options: RunOptions) -> None:
    turns = []

    class Notes(GroupComponent):
        def _compute(self) -> None:
            turns.append(self.now // STEP)

        def _update(self, value: Any) -> None:
            pass

    class Both(Drives):
        def _compute(self) -> NDArray[np.float64]:
            return np.repeat(super()._compute(), 2, axis=0)

    team = Team(
        {"drive": Both, "see": Sees, "it": Notes},
        count=2,
        state=[[0.0, 0.0], [10.0, 0.0]],
        timings={"it": Timing(condition=Expression("x > 10.21 or (x < 0.11 and time > 0)", {"x", "time"}))},
    )
    ready = simulation({"a": team})
    gone = fault(Stop, at=7, agents=[AgentSelection(ready.groups[0], [1])])
    summary = execute(ready, 12, options=replace(options, faults=[gone]))
    assert summary.status == "finished", summary.failure
    # The first is short of .11 m until step 2, the second beyond 10.21 m from step 4 on, and out of the run from 7 on.
    assert turns == [1, 2, 4, 5, 6]


class Sees(GroupComponent):
    def _compute(self) -> NDArray[np.float64]:
        return self.environment.state(self.group)

    def _update(self, value: NDArray[np.float64]) -> None:
        self.group.awareness.state = value


def test_a_condition_that_has_no_value_is_a_failure_of_the_component() -> None:
    condition = Expression('knowledge["plan"] > 1', {"knowledge"})
    summary = simulate({"a": Team({"it": noting([])}, timings={"it": Timing(condition=condition)})})
    assert summary.status == "failed"
    assert "the agent does not know `plan`" in present(summary.failure)


# Coroutines


class Waits(Component):
    """Awaits what a test says; notes what came when."""

    async def _script(self) -> None:
        raise NotImplementedError

    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        pass

    async def _async_compute(self) -> Any:
        return await self._script()


def script(body: Callable[..., Any], base: type[Waits] = Waits) -> type[Waits]:
    """A component whose turn is a coroutine function."""
    return type("Scripted", (base,), {"_script": body})


def test_a_turn_may_sleep_in_simulated_time() -> None:
    told = []

    async def body(self: Waits) -> None:
        begun = self.now
        await self.sleep(0.012)
        await self.sleep(0.01)
        told.append((begun / MILLISECOND, self.now / MILLISECOND))

    simulate({"a": Team({"it": script(body)})}, 3, options=ASYNCHRONOUS)
    assert told == [(0, 22), (50, 72), (100, 122)]


def test_a_turn_may_wait_for_an_event_of_somebody() -> None:
    told = []

    async def body(self: Waits) -> None:
        event = await self.happening("ring", "agents.*.bell")
        told.append((self.now / MILLISECOND, event.name, event.source))

    teams = {
        "a": Team({"it": script(body)}),
        "b": Team(
            {"bell": type("Bell", (Rings,), {"at": (30, 110)})}, timings={"bell": Timing(period=10 * MILLISECOND)}
        ),
    }
    summary = simulate(teams, 3, options=ASYNCHRONOUS)
    # It waits from 0 on, and again from the step after the first ring.
    assert told == [(30, "ring", "agents.b.bell"), (110, "ring", "agents.b.bell")]
    assert summary.overruns == 1


class Tells(CommunicationSender):
    def _compute(self) -> list[Message]:
        return [Message("b", "a", {"number": self.now / MILLISECOND})]


def test_a_turn_may_wait_for_messages_which_are_readable_from_the_step_after_they_were_sent() -> None:
    told = []

    class Hears(CommunicationReceiver):
        async def _async_compute(self) -> list[Message]:
            result: list[Message] = await self.messages()
            return result

        def _update(self, value: Sequence[Message]) -> None:
            told.append((self.now / MILLISECOND, [message.payload["number"] for message in value]))

    teams = {
        "a": Team({"hear": Hears}),
        "b": Team({"tell": Tells}, timings={"tell": Timing(period=30 * MILLISECOND, offset=20 * MILLISECOND)}),
    }
    simulate(teams, 5, options=ASYNCHRONOUS)
    assert told == [(50, [20]), (100, [50, 80]), (150, [110, 140]), (200, [170])]


def test_the_synchronous_mode_takes_the_plain_methods() -> None:
    async def body(self: Any) -> None:
        raise AssertionError("not in this mode")

    assert simulate({"a": Team({"it": script(body)})}).status == "finished"


def test_the_latency_lies_between_the_halves_of_a_turn_that_awaits() -> None:
    told = []

    class Both(Waits):
        async def _async_compute(self) -> float:
            await self.sleep(0.01)
            return self.now / MILLISECOND

        async def _async_update(self, value: float) -> None:
            told.append((value, self.now / MILLISECOND))

    timing = Timing(period=100 * MILLISECOND, latency=always(0.02))
    simulate({"a": Team({"it": Both}, timings={"it": timing})}, 4, options=ASYNCHRONOUS)
    assert told == [(10, 30), (110, 130)]


def test_a_period_of_zero_begins_anew_as_soon_as_a_turn_is_over() -> None:
    told = []

    async def body(self: Waits) -> None:
        await self.sleep(0.015)
        told.append(self.now / MILLISECOND)

    simulate({"a": Team({"it": script(body)}, timings={"it": Timing(period=0)})}, 2, options=ASYNCHRONOUS)
    assert told == [15, 30, 45, 60, 75, 90]


def test_awaiting_real_time_is_an_error_that_names_it() -> None:
    import asyncio

    class Future:
        def __await__(self) -> Iterator[Any]:
            yield self

    async def foreign(self: Waits) -> None:
        await untyped(Future())

    summary = simulate({"a": Team({"it": script(foreign)})}, options=ASYNCHRONOUS)
    assert summary.status == "failed"
    assert "real time, and that only a paced run can (run.pace)" in present(summary.failure)

    async def asynchronous(self: Waits) -> None:
        await asyncio.sleep(0.1)

    summary = simulate({"a": Team({"it": script(asynchronous)})}, options=ASYNCHRONOUS)
    assert summary.status == "failed"
    assert "only a paced run can (run.pace)" in present(summary.failure)


# What must never hang


def ends(kinds: Mapping[str, Any], timings: Mapping[str, Any] | None = None, steps: int = 4, **more: Any) -> RunSummary:
    return simulate({"a": Team(kinds, timings=timings or {}, **more)}, steps, options=ASYNCHRONOUS)


async def _naps(self: Waits) -> None:
    while True:
        await self.sleep(0.0)


@pytest.mark.parametrize(
    ("kinds", "timings", "named"),
    [
        ({"it": noting([])}, {"it": Timing(period=0)}, ["agents.a.it"]),
        ({"it": script(_naps)}, {}, ["agents.a.it"]),
        (
            {"one": type("One", (Rings,), {"at": (0,)}), "two": type("Two", (Rings,), {"at": (0,)})},
            {
                "one": Timing(period=10**9, trigger=Trigger("ring", component="two")),
                "two": Timing(trigger=Trigger("ring", component="one")),
            },
            ["agents.a.one", "agents.a.two"],
        ),
    ],
    ids=["period of zero", "naps", "two who trigger each other"],
)
def test_a_circle_in_which_no_time_passes_ends_the_run_and_is_named(
    kinds: dict[str, Any], timings: dict[str, Any], named: list[str]
) -> None:
    summary = ends(kinds, timings)
    assert summary.status == "failed"
    assert "no time passes any more" in present(summary.failure)
    assert all(f"`{name}`" in present(summary.failure) for name in named)


def test_in_the_synchronous_mode_two_components_trigger_each_other_once_a_step() -> None:
    class Echo(Rings):
        def _update(self, value: Any) -> None:
            self.emit("ring")

    timings = {
        "one": Timing(period=10**9, trigger=Trigger("ring", component="two")),
        "two": Timing(trigger=Trigger("ring", component="one")),
    }
    summary = simulate({"a": Team({"one": Echo, "two": Echo}, timings=timings)}, 5)
    assert (summary.status, summary.turns) == ("finished", 10)


def test_a_component_that_waits_in_vain_is_named_at_the_end(tmp_path: Path) -> None:
    async def one(self: Waits) -> None:
        await self.happening("go", "agents.a.two")
        self.emit("go")

    async def two(self: Waits) -> None:
        await self.happening("go", "agents.a.one")
        self.emit("go")

    log = tmp_path / "run.mcap"
    team = Team({"one": script(one), "two": script(two)})
    summary = simulate({"a": team}, 3, log, ASYNCHRONOUS)
    assert (summary.status, summary.overruns) == ("finished", 4)
    last = list(open_log(log).events())[-1]
    assert last.name == "finished"
    assert last.level == "WARNING"
    assert last.data["waiting"] == [
        "agents.a.one for the event go of agents.a.two",
        "agents.a.two for the event go of agents.a.one",
    ]


@settings(max_examples=40)
@given(
    where=st.sampled_from(["begin", "after a sleep", "after an event", "update", "nan", "subscriber", "cancelled"]),
    at=st.integers(0, 5),
    row=st.integers(0, 2),
    latency=st.sampled_from([0.0, 0.02, 0.07]),
)
def test_any_failure_at_any_time_ends_the_run_with_a_finished_log(
    where: str, at: int, row: int, latency: float
) -> None:
    import asyncio
    import tempfile

    class Fails(Waits):
        def _trouble(self, place: str) -> None:
            if self.now >= at * STEP and self._agent.row == row and where == place:
                raise asyncio.CancelledError if place == "cancelled" else ZeroDivisionError("on purpose")

        async def _async_compute(self) -> None:
            self._trouble("begin")
            self._trouble("cancelled")
            await self.sleep(0.01)
            self._trouble("after a sleep")
            await self.happening("stepped")
            self._trouble("after an event")

        async def _async_update(self, value: Any) -> None:
            self._trouble("update")
            if where == "nan" and self.now >= at * STEP and self._agent.row == row:
                self._agent.model.control_input = [np.nan, 0.0]
            self.emit("tick")

        def initialise_component(
            self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, Any]
        ) -> None:
            super().initialise_component(agent, awareness, knowledge)
            self.subscribe("tick", lambda event: self._trouble("subscriber"))

    timing = Timing(latency=always(latency))
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        team = Team({"it": Fails}, count=3, timings={"it": timing})
        summary = simulate({"a": team}, 10, log, ASYNCHRONOUS)
        recorded = open_log(log)
        assert recorded.verify() is None
        assert present(recorded.outcome)["status"] == "failed"
        events = [event for event in recorded.events() if event.name == "failed"]
    assert summary.status == "failed"
    assert [event.source for event in events] == [f"agents.a.{row}.it"]


# Repeating


def test_the_asynchronous_example_repeats_itself_in_another_process(scenarios: Path) -> None:
    assert_repeatable(scenarios / "asynchronous.yaml", ["run.duration=6"], timeout=120)


CHANCE = """
symaware: 1
name: chance
seed: 3
run: {mode: asynchronous, duration: 1.0}
environment: {use: kinematic}
agents:
  robot:
    count: 7
    model: {use: single-integrator}
    state: {uniform: [-5, 5]}
    knowledge: {goal: [0, 0]}
    components:
      see:
        use: perception.range
        with: {range: 4, position_noise: 0.1, self_noise: 0.1, dropout: 0.2}
        period: 0.03
        jitter: 0.02
      believe: {use: uncertainty.gaussian, period: 0.02, offset: 0.007}
      paper:
        use: doubles.paper
        period: 0.015
        jitter: 0.01
        latency: {normal: [0.01, 0.01], least: 0}
        overrun: queue
      steer:
        use: control.go-to-goal
        trigger: {event: updated, of: paper}
        condition: x > 0
        latency: {uniform: [0, 0.02]}
"""


def test_all_that_is_drawn_repeats_itself(tmp_path: Path, doubles: Path) -> None:
    scenario = tmp_path / "chance.yaml"
    scenario.write_text(CHANCE)
    assert_repeatable(scenario, timeout=120)


class Follows(Controller):
    def _compute(self) -> Any:
        return self.random.standard_normal(2), TimeSeries()


@settings(max_examples=15)
@given(order=st.permutations(["a", "b", "c"]))
def test_the_order_of_groups_changes_nothing_about_them(order: list[str]) -> None:
    def outcome(order: list[str]) -> dict[str, bytes]:
        timing = Timing(
            period=17 * MILLISECOND, jitter=9 * MILLISECOND, latency=ProbabilityDistribution(uniform=(0.0, 0.03))
        )
        ready = simulation({name: Team({"go": Follows}, 2, timings={"go": timing}) for name in order})
        execute(ready, 5, options=ASYNCHRONOUS)
        return {group.name: ready.environment.state(group).tobytes() for group in ready.groups}

    assert outcome(order) == outcome(["a", "b", "c"])


@pytest.mark.slow
def test_two_hundred_agents_at_100_hz_take_exactly_a_thousand_turns_each_in_ten_seconds(tmp_path: Path) -> None:
    counts: dict[Any, Any] = {}

    class Counts(Component):
        def _compute(self) -> None:
            counts[self.path] = counts.get(self.path, 0) + 1

        def _update(self, value: Any) -> None:
            pass

    timing = Timing(period=10 * MILLISECOND, jitter=5 * MILLISECOND)
    team = Team({"it": Counts, "also": Counts}, 200, timings={"it": timing, "also": Timing(period=10 * MILLISECOND)})
    summary = simulate({"a": team}, 200, tmp_path / "run.mcap", ASYNCHRONOUS)
    assert set(counts.values()) == {1000}
    assert (len(counts), summary.turns) == (400, 400_000)
