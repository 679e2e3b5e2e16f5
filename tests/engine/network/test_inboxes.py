"""Inboxes of agents that take part no more, or take part again."""

import numpy as np

from symaware_cli import Delivery, MessageBatch
from symaware_cli.engine.network.inboxes import Inboxes

IDS = ("a", "b.0", "b.1")


def delivery(*receivers: int, kind: str = "state") -> Delivery:
    """What one of three tells some of the others."""
    count = len(receivers)
    rows, numbers = np.zeros(count, np.intp), np.zeros(count, np.int64)
    batch = MessageBatch(np.array([0]), {"value": np.array([1.0])}, kind)
    return Delivery(batch, rows, np.array(receivers), numbers, 0, numbers)


def filled() -> Inboxes:
    """Inboxes for what a group reads in columns, and for what its members read by themselves."""
    inboxes = Inboxes(IDS, None)
    inboxes.open("agents.b.hear", IDS[1:], ["state"], columns=True)
    fill(inboxes)
    return inboxes


def fill(inboxes: Inboxes) -> None:
    for receiver in range(len(IDS)):
        inboxes.put(delivery(receiver, kind="word"))
        inboxes.put(delivery(receiver))
    inboxes.put(delivery(1, 2))
    inboxes.put(delivery(1))
    inboxes.put(delivery(1, 2, kind="word"))


def read(inboxes: Inboxes) -> tuple[list[list[str]], list[int]]:
    """For whom there is something in columns, and singly."""
    columns = [[IDS[receiver] for receiver in each.receivers] for each in inboxes.collect("agents.b.hear")]
    return columns, [len(inboxes.receive(id)) for id in IDS]


def test_all_messages_are_kept_for_agents_that_take_part() -> None:
    assert read(filled()) == ([["b.0"], ["b.1"], ["b.0", "b.1"], ["b.0"]], [2, 2, 2])


def test_unread_messages_are_dropped_when_an_agent_stops() -> None:
    inboxes = filled()
    inboxes.close("b.0")
    assert read(inboxes) == ([["b.1"], ["b.1"]], [2, 0, 2])


def test_nothing_is_kept_for_an_agent_that_stopped() -> None:
    inboxes = filled()
    inboxes.close("b.0")
    read(inboxes)
    fill(inboxes)
    assert read(inboxes) == ([["b.1"], ["b.1"]], [2, 0, 2])
    inboxes.close("b.1")
    fill(inboxes)
    assert not inboxes.has("b.1")
    assert read(inboxes) == ([], [2, 0, 0])


def test_an_agent_that_takes_part_again_receives_messages_from_then_on() -> None:
    inboxes = filled()
    inboxes.close("b.0")
    fill(inboxes)
    inboxes.reopen("b.0")
    assert not inboxes.has("b.0")
    read(inboxes)
    fill(inboxes)
    assert read(inboxes) == read(filled())
