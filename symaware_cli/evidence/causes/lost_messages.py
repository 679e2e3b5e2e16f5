"""The links of a run with lost or late messages, found by repeating the run, since logs need not contain messages."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from symaware_cli.core import Event
from symaware_cli.evidence.branch_changes import BranchError
from symaware_cli.evidence.causes.candidate import LinkMessages
from symaware_cli.language import prepared
from symaware_cli.language.build import Built

#: Reasons of losses that do not depend on the channel.
_IRREPARABLE = ("no-link", "absent")


def has_messages(built: Built) -> bool:
    """Whether any component of a scenario reads messages."""
    return any(entry.listens or entry.kinds is not None for entry in built.simulation.entries)


def links_with_losses(built: Built, begin: float, end: float) -> list[LinkMessages]:
    """Repeat a run, and list the links with messages that were lost or late.

    Args:
        built: The scenario, which is run.
        begin: The time from which on messages are counted when sent [s].
        end: The time until which the run is repeated, and before which counted messages should have arrived [s].

    Raises:
        BranchError: The run failed.
        KeyboardInterrupt: A signal ended the run.
    """
    simulation = built.simulation
    ids, step = simulation.environment.roster.ids, simulation.environment.time_step
    lost: Counter[tuple[int, int]] = Counter()
    late: Counter[tuple[int, int]] = Counter()
    # Messages that are overdue: the number of the sender, with the link.
    waiting: dict[tuple[int, int], set[int]] = {}

    def look(event: Event) -> None:
        traffic = event.subject
        delivery = traffic.delivery
        timely = (delivery.sent_time // step + 1) * step
        if delivery.sent_time / 1e9 < begin or timely / 1e9 >= end:
            return
        links = list(zip(delivery.senders.tolist(), delivery.receivers.tolist(), strict=True))
        for link, number in zip(links, delivery.sequences.tolist(), strict=True):
            if traffic.stage == "sent":
                waiting.setdefault(link, set()).add(number)
            else:
                waiting[link].discard(number)
        if traffic.stage == "sent":
            return
        if traffic.stage == "delivered":
            if event.time > timely:
                late.update(links)
            return
        reasons = [traffic.reasons[number] for number in traffic.reason.tolist()]
        lost.update(link for link, why in zip(links, reasons, strict=True) if why not in _IRREPARABLE)

    simulation.events.subscribe("traffic", look)
    with prepared(replace(built, options=replace(built.options, pace=None)), None, may_exit=False) as run:
        run.advance(until=lambda: simulation.clock.now / 1e9 >= end)
        if run.signal is not None:
            raise KeyboardInterrupt
        if run.failure is not None:
            raise BranchError(f"the run cannot be repeated: {run.failure.problem}")
    for link, numbers in waiting.items():
        late[link] += len(numbers)
    return [
        LinkMessages(ids[sender], ids[receiver], lost[sender, receiver], late[sender, receiver])
        for sender, receiver in sorted({*lost, *late})
        if lost[sender, receiver] or late[sender, receiver]
    ]
