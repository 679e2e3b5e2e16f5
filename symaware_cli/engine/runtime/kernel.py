"""The kernel: the loop over the instants of simulated time, in either mode.

It knows times, places and the handlers registered for them, but no components, agents or recorders.

Reasons: docs/decisions/0013-virtual-clock.md
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Protocol

from symaware_cli.engine.runtime.queue import Queue


class Hooks(Protocol):
    """The functions that a kernel calls at each instant besides turns, in this order."""

    def begin(self, now: int, is_step: bool) -> None:
        """Begin an instant: deliver the messages that are due, before all turns.

        Args:
            now: The instant, in nanoseconds.
            is_step: Whether the instant is a step of the world.
        """

    def settle(self) -> bool:
        """After all turns, send their messages; return whether that may have queued further turns."""

    def end(self, now: int, is_step: bool) -> str | None:
        """End an instant, before the world moves; return why the run ends, if it does."""

    def await_next(self, upcoming: int) -> int:
        """Wait until it is time for an instant [ns]; return it, or an earlier one with something to process."""

    def pause(self) -> None:
        """Prepare for instants before the next step: they must not change the present step of the world."""

    def step(self, upcoming: int) -> str | None:
        """Step the world, before the clock advances; return why the run ends, if it does."""

    def stepped(self) -> None:
        """Process a step, after the world and the clock have advanced."""


class Kernel:
    """Advances simulated time from instant to instant.

    At each instant, first the turns that are taken at every step run in the order of places, interleaved with the queue
    entries of these places, then all other queue entries are processed. The world moves last.

    Attributes:
        queue: The queue of all entries that are not taken at every step; it sets the clock.
        time_step: The world's time step, in nanoseconds.
        next_step: The next instant that is a step of the world, in nanoseconds.
        began: The first instant, in nanoseconds: later than 0 if this process joined a run of several processes.
        done: The number of steps made.
        steps: The greatest number of steps.
        is_at_step: Whether the present instant is a step of the world.
        has_begun: Whether the run has begun.
        yields_within_steps: Whether `run` yields within each step, once all turns are taken and before anything acts on
            the control inputs, instead of before it.
    """

    def __init__(self, queue: Queue, time_step: int, steps: int) -> None:
        self.queue = queue
        self.time_step = time_step
        self.next_step = 0
        self.began = 0
        self.done = 0
        self.steps = steps
        self.is_at_step = self.has_begun = self.yields_within_steps = False
        #: The functions called at each step, with their places, in the order of places.
        self.steady: list[tuple[int, Callable[[], object]]] = []

    @property
    def is_complete(self) -> bool:
        """Whether all steps were made."""
        return self.done == self.steps

    def join(self, step: int, time: int) -> None:
        """Join a run of several processes at its present step.

        Args:
            step: The number of steps made.
            time: Simulated time in nanoseconds.
        """
        self.done, self.began, self.next_step = step, time, time
        self.queue.begin(time)

    def run(self, hooks: Hooks) -> Generator[None, None, str | None]:
        """Process instants, from a step of the world on, yielding before each step but the first.

        Between two steps nothing is in progress, and the clock is at an instant that has not begun. With
        `yields_within_steps` it yields within each step, the first one included.

        Returns:
            The reason given by a hook that ended the run; None if all steps were made.
        """
        queue, steady, time_step = self.queue, self.steady, self.time_step
        entries, clock = queue.entries, queue.clock
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
            if is_step and self.yields_within_steps:
                yield
            ending = hooks.end(now, is_step)
            if ending is not None:
                return ending
            upcoming = self.next_step
            if entries and entries[0][0] < upcoming:
                upcoming = entries[0][0]
            upcoming = hooks.await_next(upcoming)
            if upcoming < self.next_step:
                if is_step:
                    hooks.pause()
                queue.begin(upcoming)
                continue
            ending = hooks.step(upcoming)
            if ending is not None:
                return ending
            queue.begin(upcoming)
            self.done += 1
            hooks.stepped()
            if self.done == self.steps:
                return None
            if not self.yields_within_steps:
                yield
