"""Every model of a channel has the statistics of its parameters."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from networking import Post, laid, world
from numpy.typing import NDArray
from scipy import stats
from scipy.stats._distn_infrastructure import rv_continuous_frozen
from simulating import present, untyped

from symaware_cli.engine.network.channel.channel import Channel
from symaware_cli.engine.network.channel.channel_parameters import ChannelParameters
from symaware_cli.engine.network.channel.fates import LOSS, QUEUE_FULL, TOO_OLD, Fates, Impairment
from symaware_cli.engine.network.channel.link_states import LinkStates
from symaware_cli.engine.network.network import ChannelOverride
from symaware_cli.engine.network.topology.fixed import Complete
from symaware_cli.engine.network.transmission import LinkQueue

MANY = 20_000


def parameters(**parameters: float) -> ChannelParameters:
    return ChannelParameters.model_validate({"drop": "head", **parameters})


class Link:
    """Messages over a single link, one after the other, or over many links at once."""

    def __init__(self, links: int = 1, seed: int = 7, **parameters: Any) -> None:
        self.channel = Channel(ChannelParameters.model_validate(parameters))
        self.states = LinkStates(seed, [f"robot.{number}" for number in range(links + 1)])
        self.rows, _ = self.states.rows(np.zeros(links, np.intp), np.arange(1, links + 1))

    def carry(self, now: int, size: int = 100, narrowed: float | None = None) -> Fates:
        sizes, impairment = np.full(len(self.rows), size), None
        if narrowed is not None:
            impairment = Impairment.none(len(self.rows))._replace(bandwidth=np.full(len(self.rows), narrowed))
        return self.channel.carry(self.states, self.rows, self.states.number(self.rows, now), now, sizes, impairment)


def delays(**parameters: Any) -> NDArray[np.float64]:
    """The delays of many messages, one over each link [s]."""
    fates = Link(MANY, **parameters).carry(1_000)
    assert (fates.reason == 0).all()
    return (fates.due - 1_000) / 1e9


@pytest.mark.parametrize(
    ("delay", "distribution"),
    [
        ({"uniform": [0.1, 0.3]}, stats.uniform(0.1, 0.2)),
        ({"normal": [0.2, 0.02], "least": 0}, stats.norm(0.2, 0.02)),
        ({"normal": [0.05, 0.1], "least": 0}, stats.truncnorm(-0.5, np.inf, 0.05, 0.1)),
        ({"lognormal": [0.1, 0.5]}, stats.lognorm(0.5, scale=0.1)),
        ({"exponential": 0.05}, stats.expon(scale=0.05)),
        ({"constant": 0.02, "exponential": 0.05}, stats.expon(0.02, 0.05)),
        ({"constant": 0.02, "normal": [0.05, 0.1], "least": 0}, stats.truncnorm(-0.5, np.inf, 0.07, 0.1)),
    ],
    ids=["uniform", "normal", "truncated normal", "lognormal", "exponential", "shifted", "shifted truncated"],
)
def test_delays_have_the_distribution_that_was_asked_for(
    delay: dict[str, float | list[float]], distribution: rv_continuous_frozen
) -> None:
    drawn = delays(delay=delay)
    assert (drawn >= 0).all()
    # Kolmogorov and Smirnov; the seed is fixed, so this never fails by chance.
    assert stats.kstest(drawn, untyped(distribution).cdf).pvalue > 1e-3


@pytest.mark.parametrize("delay", [{"exponential": 0.05}, {"uniform": [0.1, 0.3]}, {"lognormal": [0.1, 0.5]}])
def test_a_constant_is_what_every_message_takes_besides(delay: dict[str, float | list[float]]) -> None:
    shifted = delays(delay={"constant": 0.25, **delay})
    np.testing.assert_allclose(shifted, delays(delay=delay) + 0.25, rtol=0, atol=1e-9)
    assert shifted.min() >= 0.25


def test_so_have_the_delays_along_one_link() -> None:
    link = Link(delay={"exponential": 0.05})
    drawn = [int(link.carry(now).due[0]) - now for now in range(2_000)]
    assert stats.kstest(np.array(drawn) / 1e9, stats.expon(scale=0.05).cdf).pvalue > 1e-3


def test_jitter_is_even_and_comes_on_top() -> None:
    assert stats.kstest(delays(delay=0.05, jitter=0.02), stats.uniform(0.05, 0.02).cdf).pvalue > 1e-3
    assert (delays(delay=0.05) == 0.05).all()


@pytest.mark.parametrize("loss", [0.01, 0.2, 0.9])
def test_losses_are_as_many_as_their_probability(loss: float) -> None:
    lost = int((Link(MANY, loss=loss).carry(0).reason == LOSS).sum())
    assert stats.binomtest(lost, MANY, loss).pvalue > 1e-3


def test_losses_of_one_link_do_not_depend_on_each_other() -> None:
    link = Link(loss=0.3)
    lost = np.array([int(link.carry(now).reason[0] == LOSS) for now in range(4_000)])
    table = np.histogram2d(lost[:-1], lost[1:], 2)[0]
    assert stats.chi2_contingency(table).pvalue > 1e-3
    assert stats.binomtest(int(lost.sum()), 4_000, 0.3).pvalue > 1e-3


def test_bursts_begin_and_end_as_often_as_they_should() -> None:
    enter, leave = 0.05, 0.25
    link = Link(2_000, loss={"enter": enter, "leave": leave})
    lost = np.array([link.carry(now).reason == LOSS for now in range(60)])
    # The model of Gilbert and Elliott is a Markov chain, in its long-run distribution from the first message on.
    share = enter / (enter + leave)
    assert stats.binomtest(int(lost[0].sum()), 2_000, share).pvalue > 1e-3
    before, after = lost[:-1], lost[1:]
    assert stats.binomtest(int((~before & after).sum()), int((~before).sum()), enter).pvalue > 1e-3
    assert stats.binomtest(int((before & ~after).sum()), int(before.sum()), leave).pvalue > 1e-3
    # Bursts have a geometric length. Of those that begin early enough, next to none is cut off by the end.
    begins = np.argwhere(~lost[:20] & lost[1:21])
    lengths = [int(np.argmin(lost[begin + 1 :, link])) for begin, link in begins]
    counted = np.bincount(np.minimum(lengths, 12), minlength=13)[1:]
    law = stats.geom(leave)
    expected = np.array([*law.pmf(np.arange(1, 12)), law.sf(11)]) * len(lengths)
    assert stats.chisquare(counted, expected).pvalue > 1e-3


def test_in_the_bad_state_some_may_get_through_and_in_the_good_one_some_may_not() -> None:
    fates = Link(MANY, loss={"enter": 0.1, "leave": 0.1, "good": 0.02, "bad": 0.5}).carry(0)
    assert stats.binomtest(int((fates.reason == LOSS).sum()), MANY, 0.5 * 0.02 + 0.5 * 0.5).pvalue > 1e-3


def test_copies_are_as_many_as_their_probability_and_have_delays_of_their_own() -> None:
    fates = Link(MANY, duplication=0.1, delay={"exponential": 0.05}, loss=0.2).carry(0)
    kept = int((fates.reason == 0).sum())
    assert stats.binomtest(len(fates.copies), kept, 0.1).pvalue > 1e-3
    assert (fates.reason[fates.copies] == 0).all()
    assert stats.kstest(fates.copies_due / 1e9, stats.expon(scale=0.05).cdf).pvalue > 1e-3
    assert abs(np.corrcoef(fates.due[fates.copies], fates.copies_due)[0, 1]) < 0.1


def test_a_message_that_overtakes_waits_where_order_is_kept() -> None:
    free, kept = (Link(delay={"exponential": 0.05}, in_order=each, duplication=0.2) for each in (False, True))
    due = [[int(link.carry(now * 1_000_000).due[0]) for now in range(300)] for link in (free, kept)]
    assert any(after < before for before, after in zip(due[0], due[0][1:], strict=False))
    assert all(after >= before for before, after in zip(due[1], due[1][1:], strict=False))
    assert all(late >= early for early, late in zip(due[0], due[1], strict=True))


def test_messages_follow_each_other_as_fast_as_the_link_carries_them() -> None:
    link = Link(bandwidth=1000.0, delay=0.5)
    due = [int(link.carry(now, size=100).due[0]) for now in (0, 0, 0, 1_000_000_000)]
    # 100 bytes at 1000 bytes/s take 0.1 s.
    assert due == [600_000_000, 700_000_000, 800_000_000, 1_600_000_000]


def test_a_full_queue_refuses_the_newest_message() -> None:
    link = Link(bandwidth=1000.0, queue=250.0)
    fates = [link.carry(0, size=100) for _ in range(4)]
    assert [int(each.reason[0]) for each in fates] == [0, 0, QUEUE_FULL, QUEUE_FULL]
    # After 0.05 s half of the first is in the link: 150 bytes wait, and there is room for 100 more.
    assert int(link.carry(50_000_000, size=100).reason[0]) == 0


def test_a_refused_message_does_not_use_the_link() -> None:
    link = Link(bandwidth=1000.0, queue=100.0)
    assert [int(link.carry(0).reason[0]) for _ in range(3)] == [0, QUEUE_FULL, QUEUE_FULL]
    assert int(link.carry(100_000_000).due[0]) == 200_000_000


@pytest.mark.parametrize("bandwidth", [1000.0, 3000.0, 7000.0, 1e6 / 3, 3e9])
def test_the_capacity_of_a_queue_does_not_depend_on_nanoseconds(bandwidth: float) -> None:
    tail = Link(bandwidth=bandwidth, queue=160.0)
    head: LinkQueue[int] = LinkQueue(parameters(bandwidth=bandwidth, queue=160.0))
    assert [int(tail.carry(0, size=80).reason[0]) for _ in range(3)] == [0, 0, QUEUE_FULL]
    assert [head.join(0, 80, number) for number in range(3)] == [[], [], [0]]
    head.advance(0)
    # When the first is in there is room for one more.
    now = round(80e9 / bandwidth)
    assert [int(tail.carry(now, size=80).reason[0]) for _ in range(2)] == [0, QUEUE_FULL]
    head.advance(now)
    assert [head.join(now, 80, number) for number in (3, 4)] == [[], [3]]


@pytest.mark.parametrize("bandwidth", [3000.0, 7000.0, 1e9 / 3, 3e9])
def test_rounding_does_not_add_up(bandwidth: float) -> None:
    count = 2000
    tail = Link(bandwidth=bandwidth)
    head: LinkQueue[int] = LinkQueue(parameters(bandwidth=bandwidth))
    due = [int(tail.carry(0, size=80).due[0]) for _ in range(count)]
    for number in range(count):
        head.join(0, 80, number)
    expected = [(number + 1) * 80e9 / bandwidth for number in range(count)]
    assert np.abs(np.array(due) - expected).max() <= 0.51
    taken = [leaving for _, leaving in head.advance(10**15)]
    assert np.abs(np.array(taken) - expected).max() <= 0.51


@pytest.mark.parametrize("drop", ["tail", "head"])
def test_over_the_slowest_of_links_nothing_ever_arrives(drop: str) -> None:
    post = Post(laid(Complete, world(2)), {"bandwidth": 1e-9, "queue": 1e6, "drop": drop, "delay": 1e9})
    for _ in range(5):
        post.send("robot.0", "robot.1")
    post.until(1_000_000_000, 10_000_000, 10_000_000)
    assert post.exchange.in_flight == 5
    assert present(post.exchange.next_time) > 10**18


@given(
    st.lists(st.tuples(st.integers(0, 400_000_000), st.integers(32, 400)), min_size=1, max_size=40), st.integers(1, 5)
)
def test_a_queue_of_messages_holds_a_fixed_number_of_any_size(posts: list[tuple[int, int]], length: int) -> None:
    link = Link(bandwidth=1000.0, queue_length=length)
    now = 0
    inside: list[int] = []
    for gap, size in posts:
        now += gap
        inside = [leaving for leaving in inside if leaving > now]
        fates = link.carry(now, size)
        assert (fates.reason[0] == QUEUE_FULL) == (len(inside) >= length)
        if len(inside) < length:
            inside.append(int(fates.due[0]))


def test_links_count_for_themselves_and_a_queue_may_count_bytes_too() -> None:
    link = Link(3, bandwidth=1000.0, queue_length=2, queue=250.0)
    reasons = [link.carry(0, size).reason.tolist() for size in (100, 100, 40)]
    assert reasons == [[0] * 3, [0] * 3, [QUEUE_FULL] * 3]  # of three messages one is too many
    link = Link(3, bandwidth=1000.0, queue_length=3, queue=250.0)
    reasons = [link.carry(0, size).reason.tolist() for size in (100, 100, 100)]
    assert reasons == [[0] * 3, [0] * 3, [QUEUE_FULL] * 3]  # of 300 bytes fifty are too many
    assert link.carry(100_000_001, 100).reason.tolist() == [0] * 3


def test_the_line_of_a_queue_of_messages_drops_its_oldest() -> None:
    line: LinkQueue[str] = LinkQueue(parameters(bandwidth=1000.0, queue_length=3))
    line.join(0, 100, "first")
    line.advance(0)
    assert [line.join(0, 100, each) for each in ("second", "third", "fourth", "fifth")] == [
        [],
        [],
        ["second"],
        ["third"],
    ]
    assert [parcel for parcel, _ in line.advance(10**9)] == ["fourth", "fifth"]
    line = LinkQueue(parameters(bandwidth=1000.0, queue_length=1))
    line.join(0, 100, "first")
    line.advance(0)
    assert line.join(50_000_000, 100, "second") == ["second"], "what is on its way into the link cannot be dropped"


def test_a_queue_of_messages_holds_for_heads_and_tails_of_a_whole_network() -> None:
    for drop, heard in (("tail", [0.0, 1.0]), ("head", [0.0, 3.0])):
        channel = {"bandwidth": 1000.0, "queue_length": 2, "drop": drop}
        post = Post(laid(Complete, world(2)), channel, time_step=10_000_000)
        for number in range(4):
            post.send("robot.0", "robot.1", number=float(number), filling="x" * 92)
        post.until(1_000_000_000, 10_000_000, 10_000_000)
        assert [message.payload["number"] for message, _ in post.stage("delivered")] == heard
        assert [reason for _, reason in post.stage("dropped")] == ["queue-full"] * 2


def test_a_queue_counts_bytes_also_when_a_link_is_narrowed_while_messages_wait() -> None:
    link = Link(bandwidth=1e6, queue=1000.0)
    assert link.carry(0, size=900).reason == 0
    assert link.carry(0, size=80, narrowed=400.0).reason == 0
    # The 900 are in after 0.9 ms, at the pace at which they were sent; of the 80, 4 bytes in 10 ms more.
    assert link.carry(10_900_000, size=925, narrowed=400.0).reason == QUEUE_FULL
    assert link.carry(10_900_000, size=924, narrowed=400.0).reason == 0


def test_a_queue_counts_bytes_also_when_a_link_is_wide_again() -> None:
    link = Link(bandwidth=1e6, queue=100.0)
    assert link.carry(0, size=80, narrowed=400.0).reason == 0
    # After half of the time half of it waits.
    assert link.carry(100_000_000, size=61).reason == QUEUE_FULL
    fates = link.carry(100_000_000, size=60)
    assert (fates.reason.tolist(), fates.due.tolist()) == ([0], [200_060_000])
    assert link.carry(200_000_000, size=41).reason == QUEUE_FULL
    assert link.carry(200_000_000, size=40).reason == 0


def test_a_queue_without_a_bandwidth_fills_where_a_fault_sets_one() -> None:
    link = Link(queue=100.0)
    assert [int(link.carry(0).reason[0]) for _ in range(3)] == [0, 0, 0]
    assert [int(link.carry(0, narrowed=400.0).reason[0]) for _ in range(2)] == [0, QUEUE_FULL]
    assert [int(link.carry(125_000_000, size=50).reason[0]) for _ in range(2)] == [0, QUEUE_FULL]
    assert [int(link.carry(250_000_000).reason[0]) for _ in range(2)] == [0, 0]


sends = st.lists(st.tuples(st.integers(0, 40), st.integers(32, 120)), max_size=12)


@given(sends, sends, st.tuples(*[st.sampled_from([300.0, 3000.0, 1e6 / 3])] * 2))
def test_the_backlog_follows_from_the_times_at_which_messages_enter(
    before: list[tuple[int, int]], after: list[tuple[int, int]], bandwidths: tuple[float, float]
) -> None:
    link, now = Link(queue=1e6), 0
    phases: list[tuple[int, int, int]] = []
    for bandwidth, some in zip(bandwidths, (before, after), strict=True):
        for gap, size in some:
            now += gap * 1_000_000
            free = max(now, phases[-1][1] if phases else 0)
            leaving = int(link.carry(now, size=size, narrowed=bandwidth).due[0])
            phases.append((free, leaving, size))
            waiting = sum(size * (end - max(begin, now)) / (end - begin) for begin, end, size in phases if end > now)
            settled = link.states.backlog.settle(link.rows, now, link.states.free[link.rows])
            assert settled[0] == pytest.approx(waiting, rel=1e-6)


def test_a_message_that_enters_a_link_keeps_its_pace() -> None:
    line: LinkQueue[str] = LinkQueue(parameters(bandwidth=1000.0, queue=300.0))
    line.join(0, 100, "first")
    line.advance(0)
    # Half of it is in, and the other half goes on as fast although the link is narrow by now.
    line.advance(50_000_000, bandwidth=100.0)
    assert line.join(50_000_000, 251, "big") == ["big"]
    assert line.join(50_000_000, 250, "fits") == []
    assert line.advance(100_000_000, bandwidth=100.0) == [("fits", 2_600_000_000)]
    assert line.join(1_350_000_000, 175, "next") == []
    line.advance(1_350_000_000)
    assert line.join(1_350_000_000, 175, "last") == ["next"]
    assert line.join(1_350_000_000, 176, "big") == ["big"]


def test_a_line_without_a_bandwidth_waits_where_a_fault_sets_one() -> None:
    line: LinkQueue[str] = LinkQueue(parameters(queue=200.0))
    assert line.join(0, 201, "big") == ["big"]
    assert line.join(0, 100, "first") == []
    assert line.advance(0) == [("first", 0)]
    assert line.join(0, 100, "second") == []
    assert line.advance(0, bandwidth=100.0) == [("second", 1_000_000_000)]
    assert line.join(500_000_000, 150, "third") == []
    assert line.advance(1_000_000_000) == [("third", 1_000_000_000)]


def test_a_lost_message_has_used_the_link() -> None:
    link = Link(bandwidth=1000.0, loss=1.0)
    assert [int(link.carry(0).due[0]) for _ in range(2)] == [100_000_000, 200_000_000]


def test_messages_that_are_too_old_are_dropped() -> None:
    fates = Link(MANY, delay={"uniform": [0.0, 0.2]}, max_age=0.15).carry(0)
    late = fates.reason == TOO_OLD
    assert (late == (fates.due > 150_000_000)).all()
    assert stats.binomtest(int(late.sum()), MANY, 0.25).pvalue > 1e-3


def test_a_full_queue_may_drop_the_message_that_waits_longest() -> None:
    # Of messages of 132 bytes, one is on its way into the link when the others come, and there is room for one more.
    post = Post(
        laid(Complete, world(2)),
        {"bandwidth": 1000.0, "queue": 300.0, "drop": "head"},
        time_step=10_000_000,
    )
    for number in range(4):
        post.send("robot.0", "robot.1", number=float(number), filling="x" * 92)
    post.until(1_000_000_000, 10_000_000, 10_000_000)
    assert [(message.payload["number"], reason) for message, reason in post.stage("dropped")] == [
        (1.0, "queue-full"),
        (2.0, "queue-full"),
    ]
    arrived = [message.payload["number"] for message, _ in post.stage("delivered")]
    assert arrived == [0.0, 3.0]


def test_that_it_does_may_be_said_by_one_part_and_its_queue_by_another() -> None:
    everybody = frozenset({0, 1})
    parts = [{"bandwidth": 1000.0}, {"queue": 300.0}, {"drop": "head"}]
    overrides = [ChannelOverride(everybody, everybody, ChannelParameters.model_validate(each)) for each in parts]
    post = Post(laid(Complete, world(2)), overrides=overrides, time_step=10_000_000)
    for number in range(3):
        post.send("robot.0", "robot.1", number=float(number), filling="x" * 92)
    assert [message.payload["number"] for message, _ in post.stage("dropped")] == [1.0]


def test_the_tail_of_a_queue_is_its_newest() -> None:
    post = Post(laid(Complete, world(2)), {"bandwidth": 1000.0, "queue": 300.0}, time_step=10_000_000)
    for number in range(4):
        post.send("robot.0", "robot.1", number=float(number), filling="x" * 92)
    post.until(1_000_000_000, 10_000_000, 10_000_000)
    assert [message.payload["number"] for message, _ in post.stage("dropped")] == [2.0, 3.0]
    assert [message.payload["number"] for message, _ in post.stage("delivered")] == [0.0, 1.0]


def test_the_draws_of_a_link_do_not_depend_on_other_agents() -> None:
    def lost(ids: int, senders: Sequence[int]) -> set[tuple[int, int, int]]:
        post = Post(laid(Complete, world(ids)), {"loss": 0.5})
        for now in range(1, 40):
            post.post(senders)
            post.exchange.deliver(now * 50_000_000)
        return {
            (int(sender), int(receiver), int(each.delivery.sent_time))
            for each in post.traffic
            if each.stage == "dropped"
            for sender, receiver in zip(each.delivery.senders, each.delivery.receivers, strict=True)
        }

    few, more = lost(3, [0, 1]), lost(5, [0, 1, 4])
    assert few == {each for each in more if each[0] < 2 and each[1] < 3}
    assert few


@given(st.lists(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=1), max_size=12))
def test_a_link_keeps_the_row_of_its_first_message(steps: list[list[tuple[int, int]]]) -> None:
    states = LinkStates(1, [f"robot.{number}" for number in range(6)])
    known: dict[tuple[int, int], int] = {}
    for links in steps:
        rows, begun = states.rows(np.array([one for one, _ in links]), np.array([other for _, other in links]))
        new = sorted({*links} - {*known})
        assert (begun is None) == (not new)
        known |= {link: len(known) + place for place, link in enumerate(new)}
        assert rows.tolist() == [known[link] for link in links]
        if begun is not None:
            assert [*zip(*(each.tolist() for each in states.ends(begun)), strict=True)] == new
