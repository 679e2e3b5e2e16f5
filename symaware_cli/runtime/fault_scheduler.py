"""The fault scheduler: when the faults of a scenario begin and end."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from symaware_cli.core import Event, Level
from symaware_cli.runtime.environment_stepper import EnvironmentStepper
from symaware_cli.runtime.event_router import EventHandler, EventRouter
from symaware_cli.runtime.faults import Fault, Targets
from symaware_cli.runtime.membership import Membership
from symaware_cli.runtime.queue import OF_FAULTS, Phase, Queue
from symaware_cli.runtime.scheduler import TurnScheduler
from symaware_cli.runtime.simulation import Simulation


class FaultScheduler:
    """Lets faults begin and end.

    In the queue there are, at `OF_FAULTS`, entries of these kinds:

    ``begin``: the payload has the fault's position, and how long ago it should have begun, in nanoseconds.
    ``end``: the payload is the fault's position.
    """

    def __init__(
        self,
        faults: Sequence[Fault],
        simulation: Simulation,
        schedulers: Sequence[TurnScheduler],
        membership: Membership,
        motion: EnvironmentStepper,
        queue: Queue,
        router: EventRouter,
    ) -> None:
        """Create; `begin` queues the faults.

        Args:
            faults: What is to go wrong.
            simulation: See `Targets`, as for the next three.
            schedulers: See there.
            membership: See there.
            motion: See there.
            queue: Where beginnings and ends are entered.
            router: Where the events are heard with which faults come.
        """
        self._faults = faults
        self._targets = Targets(simulation, schedulers, membership, motion, self._end_named)
        self._queue = queue
        self._router = router
        self._connections: dict[int, EventHandler] = {}
        #: What ends those that have begun needs to know, by their position.
        self._ongoing: dict[int, Any] = {}
        queue.register(OF_FAULTS, {"begin": self._begin, "end": self._end})

    def begin(self) -> None:
        """Enter all in the queue, or listen for their events."""
        now = self._queue.clock.now
        for place, fault in enumerate(self._faults):
            if fault.at is not None:
                # Who joins a run late finds some faults over, and others begun.
                missed = max(0, now - fault.at)
                if fault.lasting is None or missed < fault.lasting or not missed:
                    self._put(fault.at + missed, "begin", (place, missed))
            elif fault.on is not None:
                call = partial(self._come, place)
                self._connections[place] = self._router.connect(fault.on.event, fault.on.source, call)

    def _put(self, time: int, kind: str, payload: Any) -> None:
        self._queue.put(time, OF_FAULTS, Phase.LANDING, 0, kind, payload)

    def _come(self, place: int, event: Event) -> None:
        """The event has fired that a fault comes with."""
        self._connections.pop(place).cancel()
        self._put(self._queue.clock.now, "begin", (place, 0))

    def _begin(self, row: int, payload: tuple[int, int]) -> None:
        place, missed = payload
        fault = self._faults[place]
        lasts = "" if fault.lasting is None else f" for {fault.lasting / 1e9:g} s"
        text = f"{fault.name}: {fault.text}{lasts}"
        self._targets.simulation.announce("fault", fault.source, text, level=Level.WARNING, fault=fault.name)
        self._ongoing[place] = fault.effect.begin(self._targets, fault.name)
        if fault.lasting is not None:
            self._put(self._queue.clock.now + fault.lasting - missed, "end", place)

    def _end_named(self, name: str) -> None:
        """End a fault before its time, unless it has not begun or is over already."""
        for place, fault in enumerate(self._faults):
            if fault.name == name:
                self._end(0, place)

    def _end(self, row: int, place: int) -> None:
        if place not in self._ongoing:
            return  # it was ended before
        fault = self._faults[place]
        fault.effect.end(self._targets, self._ongoing.pop(place))
        self._targets.simulation.announce("fault-over", fault.source, f"{fault.name}: over", fault=fault.name)
