"""Turns that are coroutines: they may await simulated time, events, messages, or real input and output."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Sequence
from typing import TYPE_CHECKING, Any

from symaware_cli.core import Component, GroupComponent, Level, SubscriberError
from symaware_cli.core.stateful import StateError
from symaware_cli.core.waiting import Sleep, said
from symaware_cli.engine.runtime.awaiting import REAL_TIME, ForeignWaitError, Wakeups
from symaware_cli.engine.runtime.failure import describe
from symaware_cli.engine.runtime.guard import FAILED, Guard
from symaware_cli.engine.runtime.interruption import Interrupted
from symaware_cli.engine.runtime.queue import Queue
from symaware_cli.engine.runtime.simulation import ComponentEntry, Simulation
from symaware_cli.engine.runtime.turn import TurnsInProgress, computed_at, in_turn
from symaware_cli.world import Turn

if TYPE_CHECKING:
    from symaware_cli.engine.runtime.awaiting import Awaiter, Pending

#: The outcome of a coroutine that is done.
_DONE = object()


class CoroutineTurns:
    """Runs the turns of the components of one entry as coroutines."""

    def __init__(
        self,
        simulation: Simulation,
        entry: ComponentEntry,
        place: int,
        queue: Queue,
        guard: Guard,
        progress: TurnsInProgress,
        awaiter: Awaiter,
        on_done: Callable[[int], object],
    ) -> None:
        """Prepare.

        Args:
            simulation: The simulation.
            entry: The components' entry.
            place: Its index among all entries.
            queue: The queue for wake-ups.
            guard: Calls the components.
            progress: The unfinished turns.
            awaiter: Converts awaited objects into conditions.
            on_done: Called with the row of each finished turn.
        """
        self._simulation = simulation
        self._entry = entry
        self._place = place
        self._queue = queue
        self._guard = guard
        self._progress = progress
        self._awaiter = awaiter
        self._on_done = on_done
        queue.register(place, {Wakeups.KIND: self._wake})

    def take(self, rows: Sequence[int]) -> None:
        """Begin the turns of some components; a turn may be finished at once."""
        with self._guard.supervision.supervised():
            for row in rows:
                turn = self._progress.begin(row, self._queue.clock.now)
                wakeups = Wakeups(self._queue, self._place, row)
                begun = _CoroutineTurn(self._entry.components[row], row, turn, wakeups)
                self._progress.add(row, begun)
                begun.coroutine = self._whole_turn(begun)
                self._resume(begun)

    async def _whole_turn(self, begun: _CoroutineTurn) -> None:
        """Do what `async_compute_and_update` does, with the latency between computing and updating."""
        component, latency = begun.component, self._guard.supervision.latency(begun.row, begun.turn)
        if not latency:
            await component.async_compute_and_update()
            return
        wanted = component._surroundings.events.wanted
        if "computing" in wanted:
            component._announce("computing")
        value = await component._async_compute()
        instant = component.now
        await Sleep(latency)
        if "computed" in wanted:
            component._announce("computed", value)
        with computed_at(component, instant):
            await component.async_update(value)

    def _resume(self, turn: _CoroutineTurn) -> None:
        """Resume a coroutine until it waits again or is done."""
        with in_turn(turn.component, turn.turn):
            outcome = self._guard.attempt(turn.row, self._advance, turn)
        if outcome is _DONE:
            if self._progress.remove(turn.row, turn):
                self._on_done(turn.row)
        elif outcome is FAILED:
            self._progress.remove(turn.row, turn)
        elif not turn.is_cancelled:
            turn.pending = outcome
            outcome.begin(turn.wakeups)

    def _advance(self, turn: _CoroutineTurn) -> Any:
        """Resume a coroutine once, and return the object that it awaits next."""
        bridge = self._awaiter.bridge
        try:
            if bridge is None:
                wait = turn.resume()
                return self._pending(turn, wait)
            with bridge.entered():
                wait = turn.resume()
                return self._pending(turn, wait)
        except StopIteration:
            return _DONE
        except RuntimeError as error:
            if bridge is None and str(error) == "no running event loop":
                raise ForeignWaitError("it awaits asyncio" + REAL_TIME) from error
            raise

    def _pending(self, turn: _CoroutineTurn, wait: Any) -> Pending:
        turn.waiting = wait
        try:
            return self._awaiter.pending(wait)
        except ForeignWaitError:
            assert turn.coroutine is not None
            turn.coroutine.close()
            raise

    def _wake(self, row: int, wakeup: int) -> None:
        """Resume a coroutine if its condition is fulfilled."""
        turn = self._progress.of(row)
        assert isinstance(turn, _CoroutineTurn)
        assert turn.pending is not None
        turn.wakeups.discard(wakeup)
        if not turn.pending.settle():
            return
        turn.wakeups.clear()
        guard = self._guard
        if not guard.supervision.interferes and self._entry.timing.on_failure == "stop":
            self._resume(turn)
            guard.check(None)
            return
        before = guard.snapshot()
        with guard.supervision.supervised():
            self._resume(turn)
        guard.check(before)

    def cancel(self, turn: object) -> None:
        """Cancel a turn that has begun."""
        if not isinstance(turn, _CoroutineTurn):
            return
        try:
            turn.close()
        except (SubscriberError, Interrupted):
            raise
        except BaseException as error:
            failure = self._guard.failure(turn.component, f"cannot give up its turn: {describe(error)}", error)
            self._simulation.announce("failed", failure.source, str(failure), level=Level.WARNING, **failure.data)

    @property
    def waiting(self) -> list[str]:
        """Descriptions of the turns that await something that may never happen."""
        return [
            f"{each.component.path} for {said(each.waiting)}"
            for each in self._progress
            if isinstance(each, _CoroutineTurn) and each.pending is not None and not each.pending.is_certain
        ]


class _CoroutineTurn:
    """One turn of one component, as a coroutine.

    Attributes:
        component: The component.
        row: Its row.
        turn: The turn's instant and count.
        wakeups: The queue entries at which it may resume.
        coroutine: The coroutine.
        waiting: The object that it awaits.
        pending: The condition for that object; None while the coroutine runs.
        is_cancelled: Whether the turn was cancelled.
    """

    __slots__ = ("component", "coroutine", "is_cancelled", "pending", "row", "turn", "waiting", "wakeups")

    def __init__(self, component: Component | GroupComponent, row: int, turn: Turn, wakeups: Wakeups) -> None:
        self.component = component
        self.row = row
        self.turn = turn
        self.wakeups = wakeups
        self.coroutine: Coroutine[Any, Any, Any] | None = None
        self.waiting: Any = None
        self.pending: Pending | None = None
        self.is_cancelled = False

    def captured(self) -> None:
        """Refuse: Python cannot write down where a coroutine waits.

        Raises:
            StateError: Always.
        """
        raise StateError(
            f"a turn of {self.component.path} is a suspended coroutine, which waits for {said(self.waiting)}"
        )

    def restored(self, state: None) -> None:
        """Do nothing: no turn was captured."""

    def resume(self) -> Any:
        """Resume the coroutine with the result of its condition, and return the object that it awaits next."""
        coroutine, pending = self.coroutine, self.pending
        assert coroutine is not None
        self.pending = None
        if pending is None:
            return coroutine.send(None)
        try:
            value = pending.value()
        except BaseException as error:
            return coroutine.throw(error)
        return coroutine.send(value)

    def close(self) -> None:
        """Cancel the turn and all that it waits for."""
        self.is_cancelled = True
        pending, self.pending = self.pending, None
        if pending is not None:
            pending.cancel()
        self.wakeups.clear()
        if self.coroutine is not None:
            self.coroutine.close()
