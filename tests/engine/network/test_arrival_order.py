"""What arrives is read oldest first, whoever reads it, how it was sent, and however late it is read."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networking import laid, world
from simulating import STEP

from symaware_cli import Message, MessageBatch
from symaware_cli.engine.network.channel.channel_parameters import ChannelParameters
from symaware_cli.engine.network.exchange import MessageExchange
from symaware_cli.engine.network.network import ChannelOverride, Network, TopologyPhase
from symaware_cli.engine.network.topology.fixed import Complete
from symaware_cli.processes.codec import decode, encode
from symaware_cli.processes.frame import Step

COUNT = 5

#: Who reads: the first two as a group in columns, the third by itself what is of one kind, the others anything.
GROUP, KINDRED = (0, 1), 2

TIMES = st.sampled_from([0.0, 0.02, 0.05, 0.1, 0.17, 0.4])

CHANNELS = st.builds(
    lambda delay, jitter, duplication, in_order: ChannelParameters(
        delay=delay, jitter=jitter, duplication=duplication, in_order=in_order
    ),
    TIMES | st.builds(lambda mean: {"exponential": mean}, TIMES),
    TIMES,
    st.sampled_from([0.0, 0.5]),
    st.booleans(),
)

KINDS = st.sampled_from(["news", "other"])

AGENTS = st.integers(0, COUNT - 1)

SINGLE = st.tuples(st.just("single"), AGENTS, st.none() | AGENTS, KINDS)

BATCHES = st.tuples(st.just("batch"), st.sets(AGENTS, min_size=1), st.none() | AGENTS, KINDS)

#: What is said in each of some steps, by whom, to whom (None for everybody).
TALKS = st.lists(st.lists(SINGLE | BATCHES, max_size=5), min_size=1, max_size=6)


class Room:
    """Agents who talk over an exchange."""

    environment = world(COUNT)
    ids = environment.roster.ids

    def __init__(
        self,
        base: ChannelParameters,
        others: Sequence[tuple[int, ChannelParameters]],
        talk: Sequence[list[tuple[str, Any, Any, str]]],
    ) -> None:
        topology = laid(Complete, self.environment)
        overrides = [
            ChannelOverride(frozenset({sender}), frozenset(range(COUNT)), channel) for sender, channel in others
        ]
        self.talk = talk
        self.exchange = self.opened()
        self.exchange.network = Network(
            topology.roster, [TopologyPhase(0, topology)], channel=base, overrides=overrides
        )

    def opened(self) -> MessageExchange:
        exchange = MessageExchange(self.ids, seed=3, time_step=STEP)
        exchange.inboxes.open("group", [self.ids[row] for row in GROUP], ["news"], columns=True)
        exchange.inboxes.open("alone", [self.ids[KINDRED]], ["news"], columns=False)
        return exchange

    def speak(self, step: int) -> None:
        """Say what is to be said in a step."""
        for way, who, receiver, kind in self.talk[step] if step < len(self.talk) else ():
            if way == "single":
                to = "*" if receiver is None else self.ids[receiver]
                self.exchange.send(Message(self.ids[who], to, {}, kind))
            else:
                senders = np.array(sorted(who))
                receivers = None if receiver is None else np.full(len(senders), receiver)
                self.exchange.post(MessageBatch(senders, {"said": np.zeros(len(senders))}, kind, receivers))

    def pass_time(self) -> Iterator[int]:
        """Go through the instants at which something arrives, which come with each."""
        for step in range(100):
            while (due := self.exchange.next_time) is not None and due < step * STEP:
                self.exchange.deliver(due)
                yield due
            self.exchange.deliver(step * STEP)
            yield step * STEP
            self.speak(step)
            self.exchange.flush()
        assert self.exchange.in_flight == 0


Heard = defaultdict[tuple[str, str], list[tuple[int, int]]]


def read(
    exchange: MessageExchange,
    ids: Sequence[str],
    heard: Heard,
) -> None:
    """Read all; for each receiver and reader the senders and the numbers of the messages."""
    for each in exchange.collect("group"):
        for receiver, *told in zip(
            each.receivers.tolist(), each.senders.tolist(), each.sequences.tolist(), strict=True
        ):
            heard[ids[receiver], "group"].append((told[0], told[1]))
    for id in ids:
        for reader in ("alone", ""):
            for message in exchange.receive(id, reader):
                heard[id, reader].append((ids.index(message.sender), message.sequence))


def read_at_once(room: Room) -> dict[tuple[str, str], list[tuple[int, int]]]:
    """All in the order in which it arrives, since it is read the very instant it does; ties as documented."""
    order: Heard = defaultdict(list)
    for _ in room.pass_time():
        now: Heard = defaultdict(list)
        read(room.exchange, room.ids, now)
        for key, each in now.items():
            order[key] += sorted(each)
    return order


MIXES = st.tuples(CHANNELS, st.lists(st.tuples(AGENTS, CHANNELS), max_size=3), TALKS)


@settings(max_examples=150, deadline=None)
@given(MIXES, st.sets(st.integers(1, 99), max_size=6))
def test_messages_that_are_read_late_are_in_the_order_of_their_arrival(
    mix: tuple[ChannelParameters, list[tuple[int, ChannelParameters]], list[list[tuple[Any, Any, Any, Any]]]],
    steps: set[int],
) -> None:
    late = Room(*mix)
    heard: Heard = defaultdict(list)
    for now in late.pass_time():
        if now % STEP == 0 and now // STEP in {*steps, 99}:
            read(late.exchange, late.ids, heard)
    assert heard == read_at_once(Room(*mix))


@settings(max_examples=150, deadline=None)
@given(MIXES, st.sets(st.integers(1, 99), max_size=6))
def test_it_is_so_in_the_synchronous_mode_and_in_another_process(
    mix: tuple[ChannelParameters, list[tuple[int, ChannelParameters]], list[list[tuple[Any, Any, Any, Any]]]],
    steps: set[int],
) -> None:
    host = Room(*mix)
    heard: Heard = defaultdict(list)
    told: list[Any] = []
    host.exchange.redirect_arrivals(host.ids, told.append)
    member = host.opened()
    for step in range(100):
        host.exchange.deliver(step * STEP)
        frame = decode(encode(Step(step, step * STEP, {}, (), tuple(told))))
        assert isinstance(frame, Step)
        told.clear()
        member.arrive(frame.arrived)
        if step in {*steps, 99}:
            read(member, host.ids, heard)
        host.speak(step)
    assert heard == read_at_once(Room(*mix))


@pytest.mark.parametrize("count", [2, 50])
def test_batches_that_arrive_one_after_the_other_are_not_cut_apart(count: int) -> None:
    room = Room(ChannelParameters(delay=0.02), (), [[("batch", {0, 1, 2}, None, "news")]] * count)
    for _ in room.pass_time():
        pass
    assert len(room.exchange.collect("group")) == count


def test_batches_that_mingle_are_cut_into_pieces_that_hold_what_all_receivers_may_read_together() -> None:
    room = Room(
        ChannelParameters(delay=0.02), [(3, ChannelParameters(delay=0.11))], [[("batch", {3, 4}, None, "news")]] * 3
    )
    for _ in room.pass_time():
        pass
    pieces = room.exchange.collect("group")
    assert [(each.sent_time // STEP, *set(each.senders.tolist())) for each in pieces] == [
        *((0, 4), (1, 4), (0, 3), (2, 4), (1, 3), (2, 3))
    ]
    assert all(each.receivers.tolist() == list(GROUP) for each in pieces)
