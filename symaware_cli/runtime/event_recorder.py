"""Subscribes the recorder of the log to the events of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from symaware_cli.core.event import RECURRING
from symaware_cli.runtime.interruption import Interruption

if TYPE_CHECKING:
    from symaware_cli.recording.recorder import Recorder
    from symaware_cli.runtime.simulation import Simulation


def record_events(
    recorder: Recorder, simulation: Simulation, interruption: Interruption, elsewhere: object | None
) -> None:
    """Subscribe a recorder to all events that it can record.

    Args:
        recorder: The recorder.
        simulation: The simulation whose events are recorded.
        interruption: Defers signals while an event is recorded, as events also fire within turns.
        elsewhere: The subject of events that another process records; None if there are none.
    """
    events = simulation.events
    for name, record in (
        ("*", lambda event: None if elsewhere and event.subject is elsewhere else recorder.event(event)),
        ("contact", lambda event: recorder.contact(event.subject, event.time)),
        ("traffic", lambda event: recorder.traffic(event.subject, event.time)),
    ):
        events.subscribe(name, interruption.shielded(record))
    if recorder.wants_recurring:
        for name in sorted(RECURRING - {"traffic"}):
            events.subscribe(name, interruption.shielded(recorder.recurring))
