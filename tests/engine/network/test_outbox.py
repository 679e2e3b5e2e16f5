"""What is sent singly at one instant is joined to batches."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from networking import Post

from symaware_cli import Message, MessageBatch
from symaware_cli.engine.network.outbox import Outbox

SENDS = st.lists(
    st.tuples(
        st.integers(0, 3),
        st.none() | st.integers(0, 3),
        st.sampled_from([("word",), ("word", "more"), ()]),
        st.sampled_from(["news", "other"]),
    ),
    max_size=30,
)


def joined(sends: Sequence[tuple[int, Any, tuple[str, ...], str]]) -> list[MessageBatch]:
    """The batches of some messages; each says its place among them under each of its names."""
    outbox = Outbox()
    for place, (sender, receiver, names, kind) in enumerate(sends):
        outbox.put(sender, receiver, dict.fromkeys(names, place), kind)
    batches = outbox.empty()
    assert not outbox.drafts
    return batches


@given(SENDS)
def test_each_sender_keeps_its_order_and_nothing_is_lost(sends: list[tuple[int, Any, tuple[str, ...], str]]) -> None:
    told = defaultdict(list)
    for batch in joined(sends):
        for row, sender in enumerate(batch.senders.tolist()):
            receiver = None if batch.receivers is None else int(batch.receivers[row])
            told[sender].append((receiver, batch.payload(row), batch.kind))
    assert told == {
        sender: [
            (receiver, dict.fromkeys(names, place), kind)
            for place, (who, receiver, names, kind) in enumerate(sends)
            if who == sender
        ]
        for sender in {each[0] for each in sends}
    }


@given(SENDS)
def test_a_batch_has_ascending_senders_and_no_link_twice(sends: list[tuple[int, Any, tuple[str, ...], str]]) -> None:
    for batch in joined(sends):
        senders = batch.senders.tolist()
        assert senders == sorted(senders)
        links = senders if batch.receivers is None else list(zip(senders, batch.receivers.tolist(), strict=True))
        assert len(set(links)) == len(links)


def test_messages_of_a_thousand_agents_at_one_instant_are_one_batch() -> None:
    sends = [(sender, (sender + step) % 1000, ("word",), "news") for sender in range(1000) for step in (1, 2)]
    (batch,) = joined(sends)
    assert len(batch.senders) == 2000


def test_single_messages_of_an_instant_travel_together() -> None:
    post = Post(ids=["a", "b", "c"])
    for sender, receiver in (("c", "a"), ("a", "b"), ("b", "a")):
        post.exchange.send(Message(sender, receiver, {"said": sender}))
    post.until(50_000_000, start=50_000_000)
    assert [(each.stage, each.delivery.senders.tolist()) for each in post.traffic] == [
        ("sent", [0, 1, 2]),
        ("delivered", [0, 1, 2]),
    ]
    assert [message.payload for message in post.exchange.receive("a")] == [{"said": "b"}, {"said": "c"}]


def test_a_batch_leaves_after_messages_that_were_sent_before() -> None:
    post = Post(ids=["a", "b"], kinds=["news"])
    post.exchange.send(Message("a", "b", {"said": 1.0}, "news"))
    post.post([0])
    post.until(50_000_000, start=50_000_000)
    assert [(each.sequences.tolist(), each.batch.payload(0)["said"]) for each in post.exchange.collect("news")] == [
        ([0], 1.0),
        ([1], [0.0]),
    ]
