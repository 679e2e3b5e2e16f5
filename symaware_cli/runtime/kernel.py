"""The kernel: from instant to instant of simulated time, in either mode.

It knows of times, places and what was registered for them, and of nothing that a run consists of.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Protocol

from symaware_cli.runtime.queue import Queue


class Hooks(Protocol):
    """What whoever runs a kernel does beside the turns; in the order in which an instant calls for it."""

    def begin(self, now: int, is_step: bool) -> None:
        """An instant begins: deliver what is due, before all turns.

        Args:
            now: The instant, in nanoseconds.
            is_step: Whether the world has moved with it.
        """

    def settle(self) -> bool:
        """All turns are taken: hand over what they left behind; tell whether that may have entered further ones."""

    def end(self, now: int, is_step: bool) -> str | None:
        """An instant ends, before the world moves; return why the run is over, if it is."""

    def await_next(self, upcoming: int) -> int:
        """Wait until it is time for an instant [ns]; return it, or an earlier one at which there is something to do."""

    def pause(self) -> None:
        """There are instants before the next step: the world goes on to move as it would have, whatever comes."""

    def step(self, upcoming: int) -> str | None:
        """Move the world, before the clock; return why the run is over, if it is."""

    def stepped(self) -> None:
        """The world has moved, and so has the clock."""


class Kernel:
    """Goes from instant to instant.

    An instant begins, whoever takes turns at every step takes them in the order of places, with what is in the queue
    for these places in between, and then all else that is in the queue. The world moves last.

    Attributes:
        queue: What is to happen between the steps, or at some of them; it moves the clock.
        time_step: Of the world, in nanoseconds.
        next_step: The next instant at which the world will have moved, in nanoseconds.
        began: The first instant, in nanoseconds: later than 0 where this process joined a run of others.
        done: How many steps were made.
        steps: How many are to be made, at most.
        is_at_step: Whether the present instant is one at which the world has moved.
        has_begun: Whether the first instant has come.
    """

    def __init__(self, queue: Queue, time_step: int, steps: int) -> None:
        self.queue = queue
        self.time_step = time_step
        self.next_step = time_step
        self.began = 0
        self.done = 0
        self.steps = steps
        self.is_at_step = self.has_begun = False
        #: What is called at each step, with its place, in the order of places.
        self.steady: list[tuple[int, Callable[[], object]]] = []

    @property
    def is_complete(self) -> bool:
        """Whether all steps were made."""
        return self.done == self.steps

    def join(self, step: int, time: int) -> None:
        """Begin where the world of others is by now.

        Args:
            step: How many steps were made.
            time: Simulated time, in nanoseconds.
        """
        self.done = step
        self.queue.begin(time)

    def run(self, hooks: Hooks) -> Generator[None, None, str | None]:
        """Go from instant to instant with a pause before each step but the first; return why the last was the last.

        Between two steps nothing is in progress, and the clock stands at an instant that has not begun.

        Returns:
            What a hook said; None if all steps were made.
        """
        queue, steady, time_step = self.queue, self.steady, self.time_step
        entries, clock = queue.entries, queue.clock
        self.began = self.next_step = clock.now
        while True:
            now = clock.now
            is_step = self.is_at_step = now == self.next_step
            hooks.begin(now, is_step)
            if is_step:
                self.next_step += time_step
                for place, take in steady:
                    if entries and entries[0][0] == now:
                        queue.run(place)
                    queue.place = place
                    take()
            if entries:
                queue.run()
            while hooks.settle() and entries:
                queue.run()
            over = hooks.end(now, is_step)
            if over is not None:
                return over
            upcoming = self.next_step
            if entries and entries[0][0] < upcoming:
                upcoming = entries[0][0]
            upcoming = hooks.await_next(upcoming)
            if upcoming < self.next_step:
                if is_step:
                    hooks.pause()
                queue.begin(upcoming)
                continue
            over = hooks.step(upcoming)
            if over is not None:
                return over
            queue.begin(upcoming)
            self.done += 1
            hooks.stepped()
            if self.done == self.steps:
                return None
            yield
