"""The bridge to asyncio: real input and output that components of a paced run may await, by way of asyncio."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any, ClassVar

#: Wall time that is given to what is under way when a run ends [s].
_PATIENCE = 1.0


class AsyncioBridge:
    """An asyncio loop that turns while the run waits for its time, and only then.

    A coroutine of a component is not an asyncio task: it is driven by the run, so that all that does not wait for the
    outside happens in the same order as ever. Its asyncio futures are watched here.
    """

    #: It belongs to the process.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._ready: list[Callable[[int], object]] = []

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Let code that runs in here find the loop, as code in a task of asyncio does."""
        with _running(self._loop):
            yield

    @staticmethod
    def is_awaitable(wait: Any) -> bool:
        """Whether something that was awaited is a future of asyncio."""
        return asyncio.isfuture(wait)

    def future(self, awaitable: Awaitable[Any]) -> asyncio.Future[Any]:
        """Let asyncio see to something that can be awaited.

        Raises:
            TypeError: Asyncio cannot await it.
        """
        return asyncio.ensure_future(awaitable, loop=None if asyncio.isfuture(awaitable) else self._loop)

    def watch(self, future: asyncio.Future[Any], call: Callable[[int], object]) -> Callable[..., object]:
        """Have something called when a future is done, with the instant that it is then.

        Returns:
            What `unwatch` needs.
        """
        # Says to the future that who awaits it is a driver of coroutines; see asyncio.Task.
        future._asyncio_future_blocking = False

        def done(future: asyncio.Future[Any]) -> None:
            self._ready.append(call)
            self._loop.stop()

        future.add_done_callback(done)
        return done

    @staticmethod
    def unwatch(future: asyncio.Future[Any], watch: Callable[..., object]) -> None:
        """Have nothing called any more."""
        future.remove_done_callback(watch)

    def wait(self, duration: float) -> list[Callable[[int], object]]:
        """Turn until some wall time has passed [s] or a future is done; return the calls of those that are."""
        handle = self._loop.call_later(max(0.0, duration), self._loop.stop)
        try:
            with _running(None):
                self._loop.run_forever()
        finally:
            handle.cancel()
        ready, self._ready = self._ready, []
        return ready

    def close(self) -> None:
        """Give up all that is under way."""
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
    """Let a loop, or none, be the one that runs: a notebook has one of its own, in which the whole run takes place."""
    before = asyncio._get_running_loop()
    asyncio._set_running_loop(loop)
    try:
        yield
    finally:
        asyncio._set_running_loop(before)
