"""No message is ever lost but those that the model drops."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networking import Post, laid, world

from symaware_cli import Topology
from symaware_cli.core import EVERYBODY, Message, MessageBatch
from symaware_cli.engine.network.channel.channel_parameters import ChannelParameters
from symaware_cli.engine.network.disturbance import Disturbance
from symaware_cli.engine.network.network import ChannelOverride
from symaware_cli.engine.network.topology.fixed import Complete, Random, Star
from symaware_cli.engine.network.topology.spatial import Range

MILLISECOND = 1_000_000

probability = st.sampled_from([0.0, 0.1, 0.5, 1.0])
delay = st.one_of(
    st.sampled_from([0.0, 0.003, 0.05, 0.2]),
    st.sampled_from([{"exponential": 0.05}, {"normal": [0.05, 0.05], "least": 0}, {"lognormal": [0.05, 1.0]}]),
)
loss = st.one_of(probability, st.just({"enter": 0.2, "leave": 0.4}))
channels = st.builds(
    lambda content, queue: {**content, **(queue or {})},
    st.fixed_dictionaries(
        {},
        optional={
            "delay": delay,
            "jitter": st.sampled_from([0.0, 0.01]),
            "loss": loss,
            "duplication": probability,
            "in_order": st.booleans(),
            "max_age": st.sampled_from([0.01, 0.1]),
        },
    ),
    st.one_of(
        st.none(),
        st.fixed_dictionaries(
            {
                "bandwidth": st.sampled_from([300.0, 3000.0]),
                "queue": st.sampled_from([50.0, 200.0, 1000.0]),
                "drop": st.sampled_from(["tail", "head"]),
            }
        ),
    ),
)
actions = st.lists(
    st.one_of(
        st.tuples(st.just("post"), st.sets(st.integers(0, 4), min_size=1), st.integers(1, 8)),
        st.tuples(st.just("single"), st.integers(0, 4), st.integers(0, 4)),
        st.tuples(st.just("all"), st.integers(0, 4), st.just(0)),
        st.tuples(st.just("wait"), st.integers(1, 120), st.just(0)),
        st.tuples(st.just("disturb"), st.tuples(probability, st.sampled_from([500.0, math.inf])), st.integers(0, 30)),
    ),
    min_size=5,
    max_size=40,
)
topologies = st.sampled_from([(Complete, {}), (Star, {}), (Random, {"probability": 0.5}), (Range, {"range": 2.5})])


@settings(max_examples=120, deadline=None)
@given(topologies, channels, channels, actions)
def test_a_sent_message_is_delivered_dropped_or_in_flight_at_every_instant(
    topology: tuple[type[Topology], dict[str, Any]],
    channel: dict[str, dict[str, float] | float],
    other: dict[str, float | str],
    actions: list[tuple[str, Any, int]],
) -> None:
    kind, parameters = topology
    exempt = ChannelOverride(frozenset({0, 1}), frozenset(range(5)), ChannelParameters.model_validate(other))
    post = Post(laid(kind, world(5), **parameters), channel, overrides=[exempt], kinds=["news"])
    exchange, ids, now = post.exchange, post.exchange._ids, 0
    storms: list[Disturbance] = []

    def check() -> None:
        assert exchange.sent + exchange.duplicated == exchange.delivered + exchange.dropped + exchange.in_flight
        for stage, attribute in (("sent", "sent"), ("delivered", "delivered"), ("dropped", "dropped")):
            # What is counted is what is told, and so what is recorded.
            assert post.count(stage) == getattr(exchange, attribute), stage

    for what, one, two in actions:
        if what == "post":
            post.exchange.post(MessageBatch(np.array(sorted(one)), {"said": np.zeros((len(one), two))}, "news"))
        elif what == "single" and one != two:
            exchange.send(Message(ids[one], ids[two], {"text": "x" * 40}))
        elif what == "all":
            exchange.send(Message(ids[one], EVERYBODY, {"text": "hello"}))
        elif what == "disturb":
            loss, bandwidth = one
            exchange.remove_disturbances(storms)
            storms = [Disturbance("storm", set(ids[:3]), set(ids), loss, two * MILLISECOND, bandwidth)]
            exchange.add_disturbances(storms)
        elif what == "wait":
            for _ in range(one):
                now += MILLISECOND
                exchange.deliver(now)
                check()
        exchange.flush()
        check()
    while exchange.in_flight:
        coming = exchange.next_time
        assert coming is not None
        now = max(now + MILLISECOND, coming)
        exchange.deliver(now)
        check()
    sent, arrived = (
        {(message.sender, message.sequence) for message in everything(post, stages)}
        for stages in (("sent",), ("delivered", "dropped"))
    )
    assert sent == arrived


def everything(post: Post, stages: tuple[str, ...]) -> Iterator[Message]:
    for stage in stages:
        yield from (message for message, _ in post.stage(stage))


@pytest.mark.parametrize("drop", ["tail", "head"])
def test_a_line_that_is_crowded_loses_some_and_forgets_none(drop: str) -> None:
    post = Post(laid(Complete, world(3)), {"bandwidth": 4000.0, "queue": 300.0, "drop": drop, "delay": 0.01})
    for now in range(0, 2000 * MILLISECOND, 10 * MILLISECOND):
        post.exchange.deliver(now)
        post.post(size=6)
    assert post.reasons().keys() == {"queue-full"}
    # 80 bytes each: 50 a second get through each of six links.
    assert post.exchange.delivered == pytest.approx(6 * 50 * 2.0, rel=0.05)
