"""The event recorder: what of the events of a run the recorder is told."""

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
    """Let a recorder know of all events that it can record.

    Args:
        recorder: Who is told.
        simulation: Whose events.
        interruption: Holds signals back meanwhile: events fire within turns, too, where they are let through.
        elsewhere: The subject of events that another process records; None where there is none.
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
