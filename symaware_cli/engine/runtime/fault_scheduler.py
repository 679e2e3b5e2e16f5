"""The fault scheduler: begins and ends the faults of a scenario, at their times or on their events."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import islice
from typing import Any, ClassVar

from symaware_cli.core import Event, Level
from symaware_cli.engine.runtime.environment_stepper import EnvironmentStepper
from symaware_cli.engine.runtime.event_router import EventHandler, EventRouter
from symaware_cli.engine.runtime.failure import RunError, describe
from symaware_cli.engine.runtime.fault import Fault, FaultTargets
from symaware_cli.engine.runtime.interruption import Interrupted
from symaware_cli.engine.runtime.membership import Membership
from symaware_cli.engine.runtime.queue import OF_FAULTS, Phase, Queue
from symaware_cli.engine.runtime.scheduler import TurnScheduler
from symaware_cli.engine.runtime.simulation import Simulation


class FaultScheduler:
    """Begins and ends faults.

    Attributes:
        faults: The faults of the scenario.

    Its queue entries are at the place `OF_FAULTS` and of these kinds:

    ``begin``: the payload is the fault's index, and how long ago it should have begun, in nanoseconds.
    ``end``: the payload is the fault's index.
    """

    #: The faults are part of the scenario.
    uncaptured: ClassVar[Collection[str]] = ("faults",)

    def __init__(
        self,
        faults: Sequence[Fault],
        simulation: Simulation,
        schedulers: Sequence[TurnScheduler],
        membership: Membership,
        stepper: EnvironmentStepper,
        queue: Queue,
        router: EventRouter,
    ) -> None:
        """Prepare; `begin` queues the faults.

        Args:
            faults: The faults of the scenario.
            simulation: See `FaultTargets`.
            schedulers: See `FaultTargets`.
            membership: See `FaultTargets`.
            stepper: See `FaultTargets`.
            queue: The queue for beginnings and ends.
            router: Connects faults with the events on which they begin.
        """
        self.faults = faults
        self._targets = FaultTargets(simulation, schedulers, membership, stepper, self._end_by_name, self._prevent)
        self._queue = queue
        self._router = router
        self._connections: dict[int, EventHandler] = {}
        #: What `Fault.begin` returned for each active fault, by the fault's index.
        self._effects: dict[int, Any] = {}
        #: The indices of faults that do not begin any more.
        self._prevented: list[int] = []
        queue.register(OF_FAULTS, {"begin": self._begin, "end": self._end})

    def begin(self, first: int = 0) -> None:
        """Queue each fault from an index on, or subscribe to its event."""
        now = self._queue.clock.now
        for index, fault in islice(enumerate(self.faults), first, None):
            if fault.at is not None:
                # In a process that joins a run late, some faults are over already, and others have begun.
                missed = max(0, now - fault.at)
                if fault.lasting is None or missed < fault.lasting or not missed:
                    self._put(fault.at + missed, "begin", (index, missed))
            elif fault.on is not None:
                call = partial(self._on_event, index)
                self._connections[index] = self._router.connect(fault.on.event, fault.on.source, call)

    def start(self, index: int) -> None:
        """Queue a fault that has neither a time nor an event, for the present instant.

        Between two steps, it begins before the turns of the next one, as if it had been declared for that instant.
        """
        self._put(self._queue.clock.now, "begin", (index, 0))

    def _put(self, time: int, kind: str, payload: Any) -> None:
        first = kind == "begin" and self.faults[payload[0]].precedes
        self._queue.put(time, OF_FAULTS, Phase.LANDING, -1 if first else 0, kind, payload)

    def _on_event(self, index: int, event: Event) -> None:
        """Begin a fault, as its event has fired."""
        self._connections.pop(index).cancel()
        self._put(self._queue.clock.now, "begin", (index, 0))

    def _begin(self, row: int, payload: tuple[int, int]) -> None:
        index, missed = payload
        if index in self._prevented:
            return
        fault = self.faults[index]
        lasts = "" if fault.lasting is None else f" for {fault.lasting / 1e9:g} s"
        text = f"{fault.name}: {fault.text}{lasts}"
        self._targets.simulation.announce("fault", fault.source, text, level=Level.WARNING, fault=fault.name)
        with self._failures_of(fault):
            self._effects[index] = fault.begin(self._targets)
        if fault.lasting is not None:
            self._put(self._queue.clock.now + fault.lasting - missed, "end", index)

    def _end_by_name(self, name: str) -> None:
        """End a fault early; no effect unless it is active."""
        for index, fault in enumerate(self.faults):
            if fault.name == name:
                self._end(0, index)

    def _prevent(self, name: str) -> None:
        """End a fault if it is active, and let it not begin any more."""
        for index, fault in enumerate(self.faults):
            if fault.name == name:
                self._end(0, index)
                self._prevented.append(index)
                if index in self._connections:
                    self._connections.pop(index).cancel()

    def _end(self, row: int, index: int) -> None:
        if index not in self._effects:
            return  # it has already ended
        fault = self.faults[index]
        with self._failures_of(fault):
            fault.end(self._targets, self._effects.pop(index))
        self._targets.simulation.announce("fault-over", fault.source, f"{fault.name}: over", fault=fault.name)

    @contextmanager
    def _failures_of(self, fault: Fault) -> Iterator[None]:
        """Let an exception of a fault be a failure of the run that names the fault."""
        try:
            yield
        except (Interrupted, KeyboardInterrupt, RunError):
            raise
        except BaseException as error:
            now = self._queue.clock.now
            raise RunError(f"faults.{fault.name}", fault.kind, now, describe(error), error) from error
