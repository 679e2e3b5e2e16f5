"""Awaiting several things at once: what comes first, what it came to, and what is left behind."""

import asyncio
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar, NoReturn

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulating import STEP, Team, present, simulation

from symaware_cli import CommunicationReceiver, CommunicationSender, Message
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.run import Run
from symaware_cli.engine.runtime.run_summary import RunSummary

MILLISECOND = 1_000_000
ASYNCHRONOUS = RunOptions(mode="asynchronous")
PACED = RunOptions(mode="asynchronous", pace=1.0)


class Talker(CommunicationSender):
    """Fires events and sends messages at given instants [ms], before all others."""

    events: ClassVar = {"e0": "", "e1": "", "e2": ""}

    def __init__(self, plan: Sequence[tuple[int, str]]) -> None:
        self.plan = plan

    async def _async_compute(self) -> None:
        now = 0
        for time, what in sorted(self.plan):
            if time > now:  # what is due together is fired in one turn: nobody else's comes in between
                await self.sleep((time - now) / 1000)
            now = time
            if what.startswith("e"):
                self.emit(what)
            else:
                self.send(Message(self.agent.id, what, {"sent": time}))
        await self.sleep(10.0)

    def _compute(self) -> NoReturn:
        raise AssertionError("it awaits")


class Waiter(CommunicationReceiver):
    """Awaits what it is told to, and keeps what that came to and when."""

    def __init__(self, wait: Callable[["Waiter"], Any], came: list[tuple[int, Any]]) -> None:
        self.wait = wait
        self.came = came

    async def _async_compute(self) -> None:
        value = await self.wait(self)
        self.came.append((self.now, value))
        await self.sleep(10.0)

    def _compute(self) -> NoReturn:
        raise AssertionError("it awaits")

    def _update(self, value: Any) -> None:
        pass


def made(
    wait: Callable[[Waiter], Any],
    plan: Sequence[tuple[int, str]] = (),
    steps: int = 10,
    options: RunOptions = ASYNCHRONOUS,
) -> tuple[list[tuple[int, Any]], list[Any], RunSummary]:
    """Let somebody await something; when it came and to what, what was left behind meanwhile, and the summary."""
    came: list[Any] = []
    teams = {
        "a": Team({"talk": partial(Talker, plan)}, state=[[0.0, 0.0]]),
        "b": Team({"wait": partial(Waiter, wait, came)}, state=[[9.0, 0.0]]),
    }
    run = Run(simulation(teams), steps, None, None, options)
    left: list[Any] = []
    while run.status is None:
        run.advance(1)
        if came and run.status is None and not left:
            # The two that sleep until the end, and nothing else.
            left.append([(each.place, each.kind) for each in run.kernel.queue.pending()])
            left.append(len(run.schedulers[1]._router))
    return came, left, run.summary


def test_any_of_returns_the_first_to_complete_and_its_result() -> None:
    came, left, _ = made(lambda me: me.any_of(me.sleep(0.3), me.happening("e0"), me.messages()), [(120, "e0")])
    [(now, (which, event))] = came
    assert (now, which, event.name, event.agent) == (120 * MILLISECOND, 1, "e0", "a")
    assert sorted(left[0]) == [(0, "resume"), (1, "resume")]
    assert left[1] == 0


def test_messages_that_come_too_late_stay_unread() -> None:
    async def twice(me: Waiter) -> tuple[Any, Any]:
        first = await me.any_of(me.messages(), me.sleep(0.02))
        return first, await me.any_of(me.sleep(0.3), me.messages())

    came, _, _ = made(twice, [(30, "b")])
    [(now, (first, (which, messages)))] = came
    assert first == (1, None)
    assert which == 1
    assert [message.payload["sent"] for message in messages] == [30]
    assert now > 30 * MILLISECOND


def test_all_of_has_what_each_came_to_in_their_order() -> None:
    came, left, _ = made(
        lambda me: me.all_of(me.happening("e1"), me.sleep(0.1), me.happening("e0")), [(20, "e0"), (180, "e1")]
    )
    [(now, (one, nothing, two))] = came
    assert (now, one.name, nothing, two.time) == (180 * MILLISECOND, "e1", None, 20 * MILLISECOND)
    assert left[1] == 0


def test_of_several_that_come_at_one_instant_the_first_listed_is_taken() -> None:
    for order, expected in ((("sleep", "event"), 0), (("event", "sleep"), 0)):

        def wait(me: Waiter, order: Sequence[str] = order) -> Any:
            kinds = {"sleep": me.sleep(0.1), "event": me.happening("e0")}
            return me.any_of(*(kinds[each] for each in order))

        came, left, _ = made(wait, [(100, "e0")])
        [(now, (which, value))] = came
        assert (now, which) == (100 * MILLISECOND, expected)
        assert (value is None) == (order[0] == "sleep")
        assert left[1] == 0


def test_a_decided_part_of_a_wait_leaves_nothing_behind_while_the_rest_is_awaited() -> None:
    async def wait(me: Waiter) -> Any:
        return await me.all_of(me.any_of(me.sleep(0.02), me.sleep(0.4)), me.happening("e0"))

    came: list[Any] = []
    teams = {
        "a": Team({"talk": partial(Talker, [(300, "e0")])}, state=[[0.0, 0.0]]),
        "b": Team({"wait": partial(Waiter, wait, came)}, state=[[9.0, 0.0]]),
    }
    run = Run(simulation(teams), 10, None, None, ASYNCHRONOUS)
    run.advance(2)
    queued = [(each.place, each.time // MILLISECOND) for each in run.kernel.queue.pending()]
    run.advance()
    assert queued == [(0, 300)]
    assert came[0][1][0] == (0, None)


def test_there_must_be_something_that_can_be_awaited() -> None:
    for wait, words in (
        (lambda me: me.any_of(), "nothing to wait for"),
        (lambda me: me.all_of(0.2), "cannot wait for float"),
    ):
        _, _, summary = made(wait)
        assert summary.status == "failed"
        assert words in present(summary.failure)


@pytest.mark.filterwarnings("error")
def test_real_time_can_be_awaited_among_others_in_a_paced_run_only() -> None:
    def wait(me: Waiter) -> Any:
        return me.any_of(me.sleep(10.0), me.all_of(asyncio.sleep(0.01, "slept"), me.sleep(0.02)))

    came, _, _ = made(wait, steps=3, options=PACED)
    assert came[0][1] == (1, ("slept", None))
    _, _, summary = made(wait)
    assert "it awaits coroutine, which takes real time, and that only a paced run can" in present(summary.failure)


def test_an_outside_failure_is_raised_where_it_is_awaited() -> None:
    async def refuse() -> None:
        raise OSError("refused")

    async def wait(me: Waiter) -> str | None:
        try:
            await me.any_of(me.sleep(10.0), refuse())
        except OSError as error:
            return str(error)
        return None

    came, _, summary = made(wait, steps=2, options=PACED)
    assert came[0][1] == "refused"
    assert summary.status == "finished"


def test_an_abandoned_wait_is_cancelled_outside() -> None:
    cancelled = []

    async def forever() -> None:
        try:
            await asyncio.sleep(100.0)
        except asyncio.CancelledError:
            cancelled.append(True)
            raise

    async def wait(me: Waiter) -> tuple[Any, list[Any]]:
        first = await me.any_of(forever(), me.sleep(0.01))
        await asyncio.sleep(0.005)
        return first, list(cancelled)

    came, _, _ = made(wait, steps=2, options=PACED)
    assert came[0][1] == ((1, None), [True])


LEAVES = st.one_of(
    st.tuples(st.just("sleep"), st.integers(1, 12)),
    st.tuples(st.just("event"), st.integers(0, 2)),
    st.just(("mail", 0)),
)
TREES = st.recursive(
    LEAVES,
    lambda parts: st.tuples(st.sampled_from(["any", "all"]), st.lists(parts, min_size=1, max_size=3)),
    max_leaves=7,
)
#: At which multiples of 10 ms each event fires and a message arrives, none of them at 0.
PLANS = st.tuples(*[st.one_of(st.none(), st.integers(1, 12)) for _ in range(4)])


def awaited(me: Waiter, tree: tuple[str, Any]) -> Any:
    """What a component awaits for a tree."""
    kind, content = tree
    match kind:
        case "sleep":
            return me.sleep(content / 100)
        case "event":
            return me.happening(f"e{content}")
        case "mail":
            return me.messages()
    parts = [awaited(me, part) for part in content]
    return me.any_of(*parts) if kind == "any" else me.all_of(*parts)


def modelled(tree: tuple[str, Any], plan: Sequence[int | None]) -> tuple[int | None, Any]:
    """When a tree has come, in nanoseconds, and to what: the least, or the greatest, of when its parts have."""
    kind, content = tree
    match kind:
        case "sleep":
            return 10 * MILLISECOND * content, None
        case "event":
            return (None, None) if plan[content] is None else (10 * MILLISECOND * plan[content], f"e{content}")
        case "mail":
            # It is there with the first step after it was sent.
            return (None, None) if plan[3] is None else ((10 * MILLISECOND * plan[3] // STEP + 1) * STEP, "mail")
    parts = [modelled(part, plan) for part in content]
    if kind == "all":
        times = [time for time, _ in parts if time is not None]
        return (None, None) if len(times) < len(parts) else (max(times), tuple(value for _, value in parts))
    came = [(time, which) for which, (time, _) in enumerate(parts) if time is not None]
    if not came:
        return None, None
    time, which = min(came)
    return time, (which, parts[which][1])


def plain(tree: tuple[str, Any], value: Any) -> Any:
    """What a tree came to, in the words of the model."""
    kind, content = tree
    match kind:
        case "sleep":
            return None
        case "event":
            return value.name
        case "mail":
            return "mail"
    if kind == "all":
        return tuple(plain(part, each) for part, each in zip(content, value, strict=True))
    which, chosen = value
    return which, plain(content[which], chosen)


@settings(max_examples=150, deadline=None)
@given(tree=TREES, plan=PLANS)
def test_any_tree_comes_when_and_as_its_parts_do(tree: tuple[str, Any], plan: list[int | None]) -> None:
    check_tree(tree, plan)


@pytest.mark.parametrize("plan", [[1, 3, None, 2], [4, None, 2, None]])
@pytest.mark.parametrize("kinds", [("all", "any"), ("any", "all")])
def test_waits_within_waits_come_when_and_as_their_parts_do(kinds: tuple[str, str], plan: list[int | None]) -> None:
    outer, inner = kinds
    parts = [("event", 0), ("mail", None)], [("event", 1), ("event", 2), ("sleep", 3)]
    check_tree((outer, [(inner, part) for part in parts]), plan)


def check_tree(tree: tuple[str, Any], plan: list[int | None]) -> None:
    """Check when a tree of waits is over, and what it returns, if events and a message come as planned."""
    said = [(10 * time, what) for time, what in zip(plan, ["e0", "e1", "e2", "b"], strict=True) if time is not None]
    came, left, _ = made(lambda me: awaited(me, tree), said, steps=5)
    time, value = modelled(tree, plan)
    if time is None:
        assert came == []
        return
    [(now, found)] = came
    assert (now, plain(tree, found)) == (time, value)
    assert sorted(left[0]) == [(0, "resume"), (1, "resume")]
    assert left[1] == 0
