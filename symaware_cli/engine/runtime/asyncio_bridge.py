"""The bridge to asyncio, through which components of a paced run can await real input and output."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any, ClassVar

#: Wall time that unfinished tasks are given when a run ends [s].
_PATIENCE = 1.0


class AsyncioBridge:
    """An asyncio loop that runs only while the run waits for wall time.

    A component's coroutine is not an asyncio task: the run drives it, so that everything that does not depend on real
    input keeps its order. The asyncio futures that it awaits are watched here.
    """

    #: The loop belongs to the process.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._ready: list[Callable[[int], object]] = []

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Make the loop the running one, so that code in this context finds it as in an asyncio task."""
        with _running(self._loop):
            yield

    @staticmethod
    def is_awaitable(wait: Any) -> bool:
        """Whether an awaited object is an asyncio future."""
        return asyncio.isfuture(wait)

    def future(self, awaitable: Awaitable[Any]) -> asyncio.Future[Any]:
        """Schedule an awaitable in asyncio.

        Raises:
            TypeError: Asyncio cannot await the object.
        """
        return asyncio.ensure_future(awaitable, loop=None if asyncio.isfuture(awaitable) else self._loop)

    def watch(self, future: asyncio.Future[Any], call: Callable[[int], object]) -> Callable[..., object]:
        """Call a function when a future is done, with the instant at that time.

        Returns:
            The callback, for `unwatch`.
        """
        # As asyncio.Task does: tells the future that its awaiting is handled.
        future._asyncio_future_blocking = False

        def done(future: asyncio.Future[Any]) -> None:
            self._ready.append(call)
            self._loop.stop()

        future.add_done_callback(done)
        return done

    @staticmethod
    def unwatch(future: asyncio.Future[Any], watch: Callable[..., object]) -> None:
        """Remove a callback that `watch` returned."""
        future.remove_done_callback(watch)

    def wait(self, duration: float) -> list[Callable[[int], object]]:
        """Run the loop for a duration of wall time [s] or until a future is done; return the functions to call."""
        handle = self._loop.call_later(max(0.0, duration), self._loop.stop)
        try:
            with _running(None):
                self._loop.run_forever()
        finally:
            handle.cancel()
        ready, self._ready = self._ready, []
        return ready

    def close(self) -> None:
        """Cancel all unfinished tasks and close the loop."""
        tasks = asyncio.all_tasks(self._loop)
        for task in tasks:
            task.cancel()
        with contextlib.suppress(Exception), _running(None):
            if tasks:
                self._loop.run_until_complete(asyncio.wait(tasks, timeout=_PATIENCE))
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())
        self._loop.close()


@contextmanager
def _running(loop: asyncio.AbstractEventLoop | None) -> Iterator[None]:
    """Make a loop, or none, the running one: in a notebook, the whole run takes place within the notebook's loop."""
    before = asyncio._get_running_loop()
    asyncio._set_running_loop(loop)
    try:
        yield
    finally:
        asyncio._set_running_loop(before)
