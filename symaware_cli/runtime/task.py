"""A turn that may take time: a coroutine on the virtual clock, driven by what it waits for."""

from __future__ import annotations

from collections.abc import Coroutine, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from symaware_cli.core import Component, Event, GroupComponent
from symaware_cli.core.chance import Turn
from symaware_cli.core.waiting import Happening, Mail, Sleep, Wait
from symaware_cli.runtime.agenda import Phase
from symaware_cli.runtime.turn import in_turn

if TYPE_CHECKING:
    from symaware_cli.runtime.activity import Activity


#: What stands for the value of a call that failed.
FAILED = object()

_REAL_TIME = ", which takes real time, and that only a paced run can (run.pace)"


@contextmanager
def computed(component: Component | GroupComponent, instant: int) -> Iterator[None]:
    """Let a component know when the value was computed that it is given meanwhile.

    Args:
        component: Which one.
        instant: In nanoseconds.
    """
    vars(component)["_computed_at"] = instant
    try:
        yield
    finally:
        vars(component).pop("_computed_at", None)


class ForeignWaitError(Exception):
    """A component awaits what simulated time knows nothing of."""


class Task:
    """One turn of one component.

    Attributes:
        component: Whose turn it is.
        waiting: What it waits for, if it waits.
    """

    __slots__ = (
        "_activity",
        "_connection",
        "_coroutine",
        "_event",
        "_given_up",
        "_row",
        "_turn",
        "component",
        "waiting",
    )

    def __init__(self, activity: Activity, row: int, component: Component | GroupComponent, turn: Turn) -> None:
        self.component = component
        self._turn = turn
        self.waiting: Any = None
        self._activity = activity
        self._row = row
        self._coroutine: Coroutine[Any, Any, Any] | None = None
        self._connection: Any = None
        self._event: Event | None = None
        self._given_up = False

    @property
    def waits_for_others(self) -> bool:
        """Whether it waits for what may never come."""
        return self.waiting is not None and not isinstance(self.waiting, Sleep)

    def start(self) -> None:
        """Begin the turn; it may be over at once."""
        self._coroutine = self._take_turn()
        self._activity.occupy(self._row, self)
        self._go_on(None)

    async def _take_turn(self) -> None:
        """What `async_compute_and_update` does, with the latency between its halves."""
        component, latency = self.component, self._activity.supervision.latency(self._row, self._turn)
        if not latency:
            await component.async_compute_and_update()
            return
        wanted = component._surroundings.events.wanted
        if "computing" in wanted:
            component._announce("computing")
        value = await component._async_compute()
        computed_at = component.now
        await Sleep(latency)
        if "computed" in wanted:
            component._announce("computed")
        with computed(component, computed_at):
            await component.async_update(value)

    def _go_on(self, value: Any) -> None:
        """Resume the coroutine until it waits again or is done."""
        self.waiting = None
        activity, row = self._activity, self._row
        with in_turn(self.component, self._turn):
            wait = activity.attempt(row, self._advance, value)
        if isinstance(wait, _Done):
            if activity.vacate(row, self):
                activity.over(row)
        elif wait is FAILED:
            activity.vacate(row, self)
        elif not self._given_up:
            self._wait(wait)

    def _advance(self, value: Any) -> Any:
        """One stretch of the coroutine; returns what it waits for."""
        coroutine, outside = self._coroutine, self._activity.run.outside
        assert coroutine is not None
        try:
            if outside is None:
                wait = coroutine.send(value)
            else:
                with outside.entered():
                    wait = coroutine.send(value)
        except StopIteration:
            return _Done()
        except RuntimeError as error:
            if outside is None and str(error) == "no running event loop":
                raise ForeignWaitError("it awaits asyncio" + _REAL_TIME) from error
            raise
        if isinstance(wait, Wait) or (outside is not None and outside.is_awaitable(wait)):
            return wait
        coroutine.close()
        raise ForeignWaitError(f"it awaits {type(wait).__name__}" + _REAL_TIME)

    def _wait(self, wait: Any) -> None:
        self.waiting = wait
        run = self._activity.run
        match wait:
            case Sleep():
                self._wake_at(run.agenda.now + wait.duration)
            case Happening():
                self._connection = run.switchboard.connect(wait.name, wait.source, self._on_event)
            case Mail():
                if run.simulation.exchange.has_mail(wait.receiver, wait.reader):
                    self._wake_at(run.agenda.now)
                else:
                    source = f"agents.{wait.receiver}"
                    self._connection = run.switchboard.connect("received", source, self._on_event)
            case _:
                assert run.outside is not None
                run.outside.watch(wait, self._wake_at)

    def _wake_at(self, time: int) -> None:
        activity = self._activity
        activity.run.agenda.put(time, activity.place, Phase.RESUMING, self._row, self._wake)

    def _on_event(self, event: Event) -> None:
        """What was waited for is there: go on in its place."""
        run, wait = self._activity.run, self.waiting
        if isinstance(wait, Mail) and not run.simulation.exchange.has_mail(wait.receiver, wait.reader):
            return  # it was for another component
        self._connection.cancel()
        self._event = event
        self._wake_at(run.agenda.now)

    def _wake(self) -> None:
        """Go on with what was waited for, unless the turn was given up meanwhile."""
        wait = self.waiting
        if wait is None:
            return
        value: Any = None
        if isinstance(wait, Happening):
            value = self._event
        elif isinstance(wait, Mail):
            value = self._activity.run.simulation.exchange.receive(wait.receiver, wait.reader)
        self._activity.resume(self._go_on, value)

    def close(self) -> None:
        """Give the turn up."""
        self.waiting = None
        self._given_up = True
        if self._connection is not None:
            self._connection.cancel()
        if self._coroutine is not None:
            self._coroutine.close()


class _Done:
    """Stands for the end of a coroutine."""
