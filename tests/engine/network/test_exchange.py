"""The exchange within a process."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from networking import Post, laid, world
from numpy.typing import NDArray
from scipy import stats
from simulating import STEP, present

from symaware_cli import AwarenessVector, Message, MessageBatch, TimeSeries
from symaware_cli.engine.network.channel.channel_parameters import ChannelParameters
from symaware_cli.engine.network.disturbance import Disturbance
from symaware_cli.engine.network.exchange import MessageExchange, UnknownReceiverError
from symaware_cli.engine.network.network import ChannelOverride, Network, TopologyPhase
from symaware_cli.engine.network.topology.fixed import Complete, Line

IDS = ["car", "robot.0", "robot.1"]


def exchange() -> MessageExchange:
    return MessageExchange(IDS, time_step=50)


def test_a_message_is_not_there_before_the_next_step() -> None:
    post = exchange()
    post.deliver(0)
    post.send(Message("car", "robot.0", {"text": "hello"}))
    assert list(post.receive("robot.0")) == []
    post.deliver(50)
    (message,) = post.receive("robot.0")
    assert (message.payload["text"], message.sent_time) == ("hello", 0)
    assert list(post.receive("robot.0")) == []


@given(st.permutations([("car", 0), ("car", 1), ("robot.0", 0), ("robot.1", 0)]))
def test_messages_of_one_instant_are_ordered_by_sender_and_not_by_sending(order: list[tuple[str, int]]) -> None:
    order = sorted(order, key=lambda each: each[0] == "car" and each[1])  # each sender's own order stays
    post = exchange()
    for sender, number in order:
        post.send(Message(sender, "robot.0", {"number": number}))
    post.deliver(50)
    assert [(each.sender, each.sequence) for each in post.receive("robot.0")] == [
        *(("car", 0), ("car", 1), ("robot.0", 0), ("robot.1", 0))
    ]


def test_an_agent_that_reads_seldom_receives_all_messages_oldest_first() -> None:
    post = exchange()
    for step in range(3):
        post.send(Message("robot.1", "car", {"step": step}))
        post.send(Message("robot.0", "car", {"step": step}))
        post.deliver(50 * (step + 1))
    assert [(each.payload["step"], each.sender) for each in post.receive("car")] == [
        (step, sender) for step in range(3) for sender in ("robot.0", "robot.1")
    ]


def test_messages_to_an_agent_without_an_inbox_are_delivered_and_not_kept() -> None:
    delivered: list[tuple[Message, str]] = []
    post = MessageExchange(
        IDS,
        {"robot.0"},
        on_traffic=lambda traffic: delivered.extend(traffic.messages(IDS) if traffic.stage == "delivered" else ()),
        time_step=50,
    )
    for step in range(3):
        post.send(Message("car", "robot.1", {"step": step}))
        post.send(Message("car", "robot.0", {"step": step}))
        post.deliver(50 * (step + 1))
    assert len(delivered) == 6
    assert len(post.receive("robot.0")) == 3
    assert len(post.receive("robot.1")) == 0


@pytest.mark.parametrize(("sender", "receiver"), [("car", "bus"), ("bus", "car")])
def test_no_message_has_an_unknown_sender_or_receiver(sender: str, receiver: str) -> None:
    with pytest.raises(UnknownReceiverError, match="no agent `bus`"):
        exchange().send(Message(sender, receiver, {}))


class Point(NamedTuple):
    x: float
    y: float


def test_a_sent_message_cannot_be_changed() -> None:
    array, vector, names = np.zeros(2), AwarenessVector("car", [1.0, 1.0]), {"x"}
    inner: dict[str, Any] = {"a": [np.zeros(1)]}
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


def test_two_receivers_of_one_payload_do_not_share_it() -> None:
    post, payload = exchange(), {"places": ["a"]}
    for receiver in ("robot.0", "robot.1"):
        post.send(Message("car", receiver, payload))
    post.deliver(50)
    (first,), (second,) = post.receive("robot.0"), post.receive("robot.1")
    first.payload["places"].append("b")
    assert second.payload["places"] == ["a"]


def test_a_broadcast_reaches_all_agents_but_its_sender() -> None:
    post = exchange()
    post.send(Message("robot.0", "*", {"text": "hello"}))
    post.deliver(50)
    assert [len(post.receive(id)) for id in IDS] == [1, 0, 1]
    assert post.neighbours("robot.0") == ["car", "robot.1"]


def mail(
    values: Sequence[float],
    senders: tuple[int, ...] = (0, 1, 2),
    kind: str = "news",
    receivers: NDArray[np.int64] | None = None,
) -> MessageBatch:
    return MessageBatch(np.array(senders), {"said": np.array(values)}, kind, receivers)


def test_a_batch_reaches_single_readers_as_messages() -> None:
    post = exchange()
    post.send(Message("robot.1", "car", {"said": 9.0}))
    post.post(mail([1.0, 2.0, 3.0]))
    post.deliver(50)
    heard = post.receive("car")
    assert [(each.sender, float(each.payload["said"]), each.sequence) for each in heard] == [
        ("robot.0", 2.0, 0),
        ("robot.1", 9.0, 0),
        ("robot.1", 3.0, 1),
    ]


def test_a_batch_may_be_for_one_receiver_each() -> None:
    post = exchange()
    post.post(mail([1.0, 2.0], senders=(0, 2), receivers=np.array([2, 1])))
    post.deliver(50)
    assert [[float(each.payload["said"]) for each in post.receive(id)] for id in IDS] == [[], [2.0], [1.0]]


def test_a_reader_in_columns_gets_its_kinds_and_nobody_else_does() -> None:
    post = exchange()
    post.inboxes.open("agents.robot.hear", ["robot.0", "robot.1"], ["news"], columns=True)
    post.post(mail([1.0, 2.0, 3.0]))
    post.post(mail([4.0], senders=(0,), kind="other"))
    post.send(Message("car", "robot.0", {"text": "hello"}, "news"))
    post.deliver(50)
    first, single, rest = post.collect("agents.robot.hear")
    told = [
        list(zip(each.senders.tolist(), each.receivers.tolist(), each.column("said").tolist(), strict=True))
        for each in (first, rest)
    ]
    assert told == [[(0, 1, 1.0), (0, 2, 1.0), (1, 2, 2.0)], [(2, 1, 3.0)]]
    assert single.column("text").tolist() == ["hello"]
    assert list(post.collect("agents.robot.hear")) == []
    assert [each.kind for each in post.receive("robot.0")] == ["other"]
    assert [each.kind for each in post.receive("car")] == ["news", "news"]


def test_readers_of_single_agents_may_have_kinds_of_their_own_too() -> None:
    post = exchange()
    for name in ("ask", "spy"):
        post.inboxes.open(name, ["robot.0", "robot.1"], ["question"], columns=False)
    post.send(Message("car", "robot.0", {}, "question"))
    post.send(Message("car", "robot.0", {}, "answer"))
    post.post(mail([1.0], senders=(0,), kind="question"))
    post.deliver(50)
    assert post.has_mail("robot.0", "ask")
    assert [[each.kind for each in post.receive("robot.0", name)] for name in ("ask", "spy", "")] == [
        ["question", "question"],
        ["question", "question"],
        ["answer"],
    ]


def test_messages_are_ordered_by_arrival() -> None:
    post = Post(laid(Complete, world(3)), {"delay": {"exponential": 0.1}})
    for number in range(30):
        post.send(f"robot.{number % 3}", f"robot.{(number + 1) % 3}", number=number)
    post.exchange.deliver(10**10)
    delivered = [message for message, _ in post.stage("delivered")]
    due = [message.arrival_time for message in delivered]
    assert len(delivered) == len(set(due)) == 30
    assert due == sorted(due)
    assert [message.payload["number"] for message in delivered] != list(range(30))


def test_a_message_without_delay_arrives_at_the_next_step() -> None:
    post = Post(laid(Complete, world(2)))
    post.exchange.deliver(20_000_000)
    post.send("robot.0", "robot.1")
    assert post.exchange.next_time == STEP
    post.exchange.deliver(STEP - 1)
    assert post.exchange.receive("robot.1") == ()
    post.exchange.deliver(STEP)
    assert len(post.exchange.receive("robot.1")) == 1


def test_over_no_link_nothing_gets_through() -> None:
    post = Post(laid(Line, world(3)))
    post.send("robot.0", "robot.2")
    post.send("robot.0", "robot.1")
    post.exchange.post(mail([1.0, 2.0, 3.0], receivers=np.array([2, 0, 1])))
    post.until(STEP)
    assert [(message.sender, message.receiver, reason) for message, reason in post.stage("dropped")] == [
        ("robot.0", "robot.2", "no-link")
    ] * 2
    assert post.exchange.delivered == 3


def test_links_may_have_a_channel_of_their_own() -> None:
    slow, lossy = ({"delay": 0.2}, {"loss": 1.0})
    post = Post(
        laid(Complete, world(3)),
        {"delay": 0.1},
        overrides=[
            ChannelOverride(frozenset({0}), frozenset({1, 2}), ChannelParameters(**slow)),
            ChannelOverride(frozenset({0, 1}), frozenset({2}), ChannelParameters(**lossy)),
        ],
    )
    post.post()
    post.until(150_000_000)
    assert arrived(post) == [(1, 0), (2, 0), (2, 1)]
    post.until(250_000_000, 200_000_000)
    assert arrived(post) == [(0, 1), (1, 0), (2, 0), (2, 1)]
    assert post.reasons() == {"loss": 2}


def arrived(post: Post) -> list[tuple[int, int]]:
    return sorted(
        (int(sender), int(receiver))
        for each in post.traffic
        if each.stage == "delivered"
        for sender, receiver in zip(each.delivery.senders, each.delivery.receivers, strict=True)
    )


def test_topologies_may_follow_each_other_and_begin_again() -> None:
    environment = world(3)
    phases = [TopologyPhase(0, laid(Complete, environment)), TopologyPhase(2 * STEP, laid(Line, environment))]
    network = Network(environment.roster, phases, repeat=3 * STEP)
    changes = [network.update(step * STEP) for step in range(7)]
    assert [None if each is None else each.links for each in changes] == [6, None, 4, 6, None, 4, 6]
    assert list(present(changes[2]).ended) == [("robot.0", "robot.2"), ("robot.2", "robot.0")]
    assert list(present(changes[3]).begun) == [("robot.0", "robot.2"), ("robot.2", "robot.0")]


def test_a_disturbance_takes_its_share_of_those_it_is_about() -> None:
    post = Post(laid(Complete, world(40)))
    robots = [f"robot.{number}" for number in range(40)]
    post.exchange.add_disturbances([Disturbance("storm", set(robots[:20]), set(robots), 0.25, 20_000_000)])
    for step in range(10):
        post.exchange.deliver(step * STEP)
        post.post()
    dropped = post.reasons()["storm"]
    assert stats.binomtest(dropped, 20 * 39 * 10, 0.25).pvalue > 1e-3
    assert all((each.delivery.senders < 20).all() for each in post.traffic if each.stage == "dropped")


def test_a_disturbance_draws_from_the_seed_that_the_exchange_has_when_it_begins() -> None:
    def lost(seed: int, later: int | None = None) -> list[str]:
        robots = [f"robot.{number}" for number in range(12)]
        post = Post(ids=robots, seed=seed)
        if later is not None:
            post.exchange.reseed(later)
        post.exchange.add_disturbances([Disturbance("storm", set(robots), set(robots), 0.5, 0)])
        post.post()
        return [f"{message.sender} to {message.receiver}" for message, _ in post.stage("dropped")]

    assert lost(1, 5) == lost(5) != lost(1)


def due(post: Post) -> list[int]:
    """When messages arrived [ms]."""
    delivered = [each.delivery for each in post.traffic if each.stage == "delivered"]
    return [time // 1_000_000 for each in delivered for time in each.due.tolist()]


def delayed_at_first(channel: Mapping[str, float]) -> Post:
    """One robot tells another something every 50 ms, the first three times under a fault that delays it by 0.2 s."""
    post = Post(laid(Line, world(2)), channel)
    fault = Disturbance("fog", {"robot.0"}, {"robot.1"}, 0.0, 200_000_000)
    post.exchange.add_disturbances([fault])
    for step in range(12):
        post.exchange.deliver(step * STEP)
        if step == 3:
            post.exchange.remove_disturbances([fault])
        if step < 6:
            post.post([0])
    return post


def test_a_message_that_a_fault_delays_is_overtaken_by_later_ones() -> None:
    assert due(delayed_at_first({"delay": 0.01})) == [160, 210, 210, 260, 260, 310]


def test_in_order_a_delayed_message_holds_up_later_ones() -> None:
    assert due(delayed_at_first({"delay": 0.01, "in_order": True})) == [210, 260, 310, 310, 310, 310]


def test_a_message_that_a_fault_delays_may_be_too_old() -> None:
    post = delayed_at_first({"delay": 0.01, "max_age": 0.2})
    assert due(post) == [160, 210, 260]
    assert post.reasons() == {"too-old": 3}


@pytest.mark.parametrize("channel", [None, {}, {"bandwidth": 1e6}, {"bandwidth": 1e6, "queue": 1e5, "drop": "head"}])
def test_a_fault_narrows_links_of_any_kind(channel: dict[str, float | str] | None) -> None:
    post = Post(ids=["robot.0", "robot.1"]) if channel is None else Post(laid(Line, world(2)), channel)
    # 40 bytes each.
    mud = Disturbance("mud", {"robot.0"}, {"robot.1"}, 0.0, 0, bandwidth=400.0)
    post.exchange.add_disturbances([mud])
    for step in range(20):
        post.exchange.deliver(step * STEP)
        if step == 3:
            post.exchange.remove_disturbances([mud])
        if step in (0, 1, 2, 4, 10):
            post.post([0])
    first, *others, last = due(post)
    assert first == 100
    if channel and "drop" in channel:
        # What still waits when the mud is over goes on at the usual rate.
        assert others == [200, 200, 200]
    else:
        # What was sent into the mud goes at its pace, and nothing passes it there.
        assert others == [200, 300, 300]
    assert 500 <= last <= 550


def test_a_narrowed_link_drops_messages_that_its_queue_cannot_hold() -> None:
    post = Post(laid(Line, world(2)), {"bandwidth": 1e6, "queue": 100.0})
    post.exchange.add_disturbances([Disturbance("mud", {"robot.0"}, {"robot.1"}, 0.0, 0, bandwidth=400.0)])
    for step in range(40):
        post.exchange.deliver(step * STEP)
        if step < 20:
            post.post([0])
    # 400 bytes/s take 10 messages in the second, and one and a half stand in the queue.
    assert len(due(post)) == pytest.approx(11, abs=1)
    assert post.reasons().keys() == {"queue-full"}
