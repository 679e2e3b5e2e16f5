"""The exchange within a process."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli import AwarenessVector, Message, TimeSeries
from symaware_cli.network.exchange import MemoryExchange, UnknownReceiverError

IDS = ["car", "robot.0", "robot.1"]


def exchange():
    return MemoryExchange(IDS, lambda message: None, lambda message: None)


def test_a_message_is_not_there_before_the_next_step():
    post = exchange()
    post.deliver(0)
    post.send(Message("car", "robot.0", {"text": "hello"}))
    assert list(post.receive("robot.0")) == []
    post.deliver(50)
    (message,) = post.receive("robot.0")
    assert (message.payload["text"], message.sent_time) == ("hello", 0)
    assert list(post.receive("robot.0")) == []


@given(st.permutations([("car", 0), ("car", 1), ("robot.0", 0), ("robot.1", 0)]))
def test_what_arrives_is_ordered_by_who_sent_it_not_by_who_was_first(order):
    order = sorted(order, key=lambda each: each[0] == "car" and each[1])  # each sender's own order stays
    post = exchange()
    for sender, number in order:
        post.send(Message(sender, "robot.0", {"number": number}))
    post.deliver(50)
    assert [(each.sender, each.sequence) for each in post.receive("robot.0")] == [
        *(("car", 0), ("car", 1), ("robot.0", 0), ("robot.1", 0))
    ]


def test_who_does_not_listen_for_a_while_gets_everything_oldest_first():
    post = exchange()
    for step in range(3):
        post.send(Message("robot.1", "car", {"step": step}))
        post.send(Message("robot.0", "car", {"step": step}))
        post.deliver(step)
    assert [(each.payload["step"], each.sender) for each in post.receive("car")] == [
        (step, sender) for step in range(3) for sender in ("robot.0", "robot.1")
    ]


def test_what_arrives_for_somebody_who_never_listens_is_delivered_and_not_kept():
    delivered = []
    post = MemoryExchange(IDS, lambda message: None, delivered.append, listening={"robot.0"})
    for step in range(3):
        post.send(Message("car", "robot.1", {"step": step}))
        post.send(Message("car", "robot.0", {"step": step}))
        post.deliver(step)
    assert len(delivered) == 6
    assert len(post.receive("robot.0")) == 3
    assert len(post.receive("robot.1")) == 0


@pytest.mark.parametrize(("sender", "receiver"), [("car", "bus"), ("bus", "car")])
def test_nobody_writes_to_or_as_somebody_who_does_not_exist(sender, receiver):
    with pytest.raises(UnknownReceiverError, match="no agent `bus`"):
        exchange().send(Message(sender, receiver, {}))


class Point(NamedTuple):
    x: float
    y: float


def test_what_was_sent_cannot_be_changed_any_more():
    array, vector, inner, names = np.zeros(2), AwarenessVector("car", [1.0, 1.0]), {"a": [np.zeros(1)]}, {"x"}
    payload = {"array": array, "vector": vector, "inner": inner, "names": names, "point": Point(1.0, 2.0)}
    post = exchange()
    post.send(Message("car", "robot.0", payload))
    array[:], vector.state, vector.intent = 9, np.array([9.0, 9.0]), TimeSeries({0.0: 9.0})
    inner["a"][0][:] = 9
    inner["a"].append(9)
    names.add("y")
    payload["more"] = 9
    post.deliver(50)
    (message,) = post.receive("robot.0")
    assert message.payload["array"].tolist() == [0.0, 0.0]
    assert message.payload["vector"].state.tolist() == [1.0, 1.0]
    assert len(message.payload["vector"].intent) == 0
    assert message.payload["inner"]["a"][0].tolist() == [0.0]
    assert len(message.payload["inner"]["a"]) == 1
    assert message.payload["names"] == {"x"}
    assert message.payload["point"] == Point(1.0, 2.0)
    assert set(message.payload) == {"array", "vector", "inner", "names", "point"}
    with pytest.raises(ValueError, match="read-only"):
        message.payload["array"][0] = 1


def test_two_receivers_of_one_payload_do_not_share_it():
    post, payload = exchange(), {"places": ["a"]}
    for receiver in ("robot.0", "robot.1"):
        post.send(Message("car", receiver, payload))
    post.deliver(50)
    (first,), (second,) = post.receive("robot.0"), post.receive("robot.1")
    first.payload["places"].append("b")
    assert second.payload["places"] == ["a"]
