"""Random draws are keyed only by seed, purpose, turn, the drawing agent and the other agent."""

import itertools
import pickle
import subprocess
import sys
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats
from simulating import untyped

from symaware_cli.world.chance import (
    AgentChance,
    GroupChance,
    Turn,
    agent_numbers,
    combined,
    fraction,
    generator,
    key_of,
    message_fractions,
    philox,
    standard_normal,
    uniform,
)

# D. E. Shaw Research, Random123 1.14, tests/kat_vectors: philox4x32 with 10 rounds.
KNOWN = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]

IDS = [f"robot.{row}" for row in range(200)]
NUMBERS = agent_numbers(IDS)
NOBODY = np.zeros(len(IDS), np.uint64)

GOLDEN = {
    "group": [0.17108101244243923, -0.9325804132795198, 0.5943937213110296, 0.2354176894313701],
    "pair": [[0.706186810979578, -0.5255604309444839]],
    "agent": [0.8759945342357607, 0.8832666205343175],
    "single": 0.6076727726443355,
}
"""First drawn with version 0.2.0; a change alters the meaning of every seed."""


def long(words: tuple[int, ...]) -> list[int]:
    """Numbers of 64 bits from pairs of words, the low one first."""
    return [low | high << 32 for low, high in zip(words[::2], words[1::2], strict=True)]


def golden() -> dict[str, float | list[Any]]:
    group = GroupChance(7, "component sense", NUMBERS[:2]).at(Turn(50_000_000))
    return {
        "group": [*group.standard_normal(3)[1].tolist(), *group.uniform(1, "dropout")[1].tolist()],
        "pair": group.standard_normal_of(np.array([1]), NUMBERS[:1], 2).tolist(),
        "agent": AgentChance(7, "agents.robot.0.steer").at(Turn(50_000_000)).random(2).tolist(),
        "single": fraction(7, "agents.robot.0.steer", "latency", 50_000_000, 0),
    }


@pytest.mark.parametrize("many", [1, 3, 5000])
@pytest.mark.parametrize(("counter", "key", "expected"), KNOWN)
def test_philox_equals_the_published_test_vectors(
    counter: tuple[int, int, int, int], key: tuple[int, int], expected: tuple[int, int, int, int], many: int
) -> None:
    first, second = (np.full(many, number, np.uint64) for number in long(counter))
    for each in (long(key)[0], np.full(many, long(key)[0], np.uint64)):
        even, odd = philox(first, second, each)
        for word, wanted in zip((even[0], odd[0], even[1], odd[1]), expected, strict=True):
            assert (word == wanted).all()


def test_draws_stay_the_same_from_version_to_version() -> None:
    assert golden() == GOLDEN


def test_another_process_with_other_hashes_draws_the_same() -> None:
    code = (
        "from symaware_cli.world.chance import *; g = GroupChance(7, 'component sense', agent_numbers(['a', 'b']));"
        "print(g.at(Turn(5)).uniform(2).tolist(), AgentChance(7, 'a').at(Turn(5)).random())"
    )
    drawn = [
        subprocess.run(
            [sys.executable, "-c", code], env={"PYTHONHASHSEED": each}, capture_output=True, text=True, check=True
        ).stdout
        for each in ("1", "2")
    ]
    assert drawn[0] == drawn[1]
    group = GroupChance(7, "component sense", agent_numbers(["a", "b"])).at(Turn(5))
    assert drawn[0].strip() == f"{group.uniform(2).tolist()} {AgentChance(7, 'a').at(Turn(5)).random()}"


def test_the_global_random_state_is_not_touched() -> None:
    before = untyped(np.random.get_state())[1].tolist()  # noqa: NPY002 (the state that must not be touched)
    AgentChance(7, "a").at(Turn(0)).random(100)
    GroupChance(7, "a", NUMBERS).at(Turn(0)).standard_normal(3)
    assert untyped(np.random.get_state())[1].tolist() == before  # noqa: NPY002


def turns_of(count: int) -> Iterator[Any]:
    group = GroupChance(7, "component sense", NUMBERS)
    return (group.at(Turn(50_000_000 * number)) for number in range(count))


def test_uniform_numbers_are_uniform_along_turns_and_across_agents() -> None:
    drawn = np.array([each.uniform(2) for each in turns_of(300)])
    assert (drawn >= 0).all()
    assert (drawn < 1).all()
    for sample in (drawn[:, 17, 0], drawn[:, 18, 1], drawn[5, :, 0], drawn[6, :, 1], drawn.ravel()):
        assert stats.kstest(sample, "uniform").pvalue > 1e-3
    assert_unrelated(drawn - 0.5, 1 / 12)


def test_normal_numbers_are_normal_along_turns_and_across_agents() -> None:
    drawn = np.array([each.standard_normal(4) for each in turns_of(300)])
    for sample in (drawn[:, 17, 0], drawn[:, 18, 3], drawn[5, :, 1], drawn[6, :, 2], drawn.ravel()):
        assert stats.kstest(sample, "norm").pvalue > 1e-3
    # Each moment within five of its standard errors.
    count = drawn.size
    for power, moment, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96), (6, 15, 10395 - 225)):
        assert abs((drawn**power).mean() - moment) < 5 * np.sqrt(variance / count)
    # 1 of 15,787 is beyond 4; 15.2 of so many are expected.
    assert 2 <= (np.abs(drawn) > 4).sum() <= 35
    assert_unrelated(drawn, 1.0)


def assert_unrelated(drawn: NDArray[np.float64], variance: float) -> None:
    """No correlation from turn to turn, from an agent to its neighbour, or within a draw; nor of squares."""
    for each in (drawn, drawn**2 - (drawn**2).mean()):
        scale = (each**2).mean()
        for axis in range(3):
            one, other = np.moveaxis(each, axis, 0)[1:], np.moveaxis(each, axis, 0)[:-1]
            assert abs((one * other).mean()) / scale < 5 / np.sqrt(one.size)


def test_draws_of_neighbouring_keys_and_counters_are_independent() -> None:
    counters = np.arange(2000, dtype=np.uint64)
    nothing = np.zeros_like(counters)
    words = [np.concatenate(philox(counters, nothing, key)) for key in range(8)]
    for one, other in [*itertools.pairwise(words), *((each[:, 1:], each[:, :-1]) for each in words)]:
        flipped = np.bitwise_count(one ^ other)
        # Half of 32 bits flip: 16 on average, with a variance of 8.
        assert abs(flipped.mean() - 16) < 5 * np.sqrt(8 / flipped.size)
        assert abs(flipped.var() - 8) < 0.6


def test_links_draw_uniformly_along_a_link_and_across_links() -> None:
    links = combined(np.repeat(NUMBERS, 200), np.tile(NUMBERS, 200), key_of(7, "links"))
    assert len(np.unique(links)) == 200 * 200
    along = message_fractions(np.repeat(links[:1], 50_000), 50_000_000 * np.arange(50_000), 0)
    across = message_fractions(links, np.zeros(40_000, np.int64), 1)
    for drawn in (along, across):
        assert (drawn > 0).all()
        assert (drawn < 1).all()
        for each in drawn:
            assert stats.kstest(each, "uniform").pvalue > 1e-3
            assert abs(np.corrcoef(each[1:], each[:-1])[0, 1]) < 5 / np.sqrt(len(each))
        correlation = np.corrcoef(drawn) - np.eye(4)
        assert np.abs(correlation).max() < 5 / np.sqrt(drawn.shape[1])


def test_single_draws_are_uniform_and_open_at_both_ends() -> None:
    drawn = [fraction(7, "agents.robot.0.steer", "latency", 50 * number, 0) for number in range(5000)]
    assert stats.kstest(drawn, "uniform").pvalue > 1e-3
    assert min(drawn) > 0
    assert max(drawn) < 1


def test_two_agents_draw_independently() -> None:
    draws = np.array(
        [AgentChance(7, f"agents.robot.{row}.sense").at(Turn(0)).standard_normal(4000) for row in range(6)]
    )
    correlation = np.corrcoef(draws) - np.eye(6)
    # Of 15 independent pairs of 4000 the largest is below 0.06 with a probability of more than 99.7 %.
    assert np.abs(correlation).max() < 0.06
    assert np.abs(draws.mean(axis=1)).max() < 0.06
    assert np.abs(draws.std(axis=1) - 1).max() < 0.05


def test_first_numbers_of_an_agents_turns_are_independent() -> None:
    source = AgentChance(7, "agents.robot.0.sense")
    drawn = np.array([source.at(Turn(50_000_000 * number)).standard_normal() for number in range(4000)])
    assert stats.kstest(drawn, "norm").pvalue > 1e-3
    assert abs(np.corrcoef(drawn[1:], drawn[:-1])[0, 1]) < 5 / np.sqrt(len(drawn))


rows = st.integers(1, 6)
widths = st.integers(1, 11)
kinds = st.sampled_from(["standard_normal", "uniform"])
plans = st.lists(st.tuples(kinds, widths, st.sampled_from(["", "dropout"])), max_size=6)


def draw(group: GroupChance, plan: Sequence[tuple[str, int, str]]) -> list[NDArray[np.float64]]:
    return [getattr(group, method)(width, kind) for method, width, kind in plan]


@given(rows, rows, plans, st.permutations(range(12)))
def test_draws_do_not_depend_on_other_agents_and_their_order(
    few: int, more: int, plan: list[tuple[str, int, str]], order: list[int]
) -> None:
    small, large = (GroupChance(7, "component sense", NUMBERS[:count]).at(Turn(3)) for count in (few, few + more))
    mixed = GroupChance(7, "component sense", NUMBERS[order]).at(Turn(3))
    for one, other, shuffled in zip(draw(small, plan), draw(large, plan), draw(mixed, plan), strict=True):
        assert one.tobytes() == np.ascontiguousarray(other[:few]).tobytes()
        if few + more <= 12:
            assert shuffled[[order.index(row) for row in range(few)]].tobytes() == one.tobytes()


@given(plans, plans)
def test_draws_of_a_turn_do_not_affect_the_next(
    before: list[tuple[str, int, str]], plan: list[tuple[str, int, str]]
) -> None:
    idle, busy = (GroupChance(7, "component sense", NUMBERS[:3]) for _ in range(2))
    draw(busy.at(Turn(3)), before)
    for one, other in zip(draw(idle.at(Turn(4)), plan), draw(busy.at(Turn(4)), plan), strict=True):
        assert one.tobytes() == other.tobytes()


@given(kinds, widths, st.lists(widths, max_size=4))
def test_one_kind_of_draw_does_not_shift_another(method: str, width: int, others: list[int]) -> None:
    plain, mixed = (GroupChance(7, "component sense", NUMBERS[:3]).at(Turn(3)) for _ in range(2))
    for other in others:
        mixed.uniform(other, "dropout")
        mixed.standard_normal(other, "bias")
        mixed.standard_normal_of(np.array([0, 2]), NUMBERS[:2], other)
    assert getattr(plain, method)(width).tobytes() == getattr(mixed, method)(width).tobytes()


@given(kinds, widths, widths)
def test_drawing_again_in_a_turn_gives_other_numbers(method: str, width: int, again: int) -> None:
    group = GroupChance(7, "component sense", NUMBERS[:3]).at(Turn(3))
    first, second = getattr(group, method)(width), getattr(group, method)(again)
    assert not np.intersect1d(first, second).size
    assert first.shape == (3, width)


@pytest.mark.parametrize("method", ["standard_normal_of", "uniform_of"])
@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), max_size=20, unique=True), widths, st.data())
def test_draws_about_another_agent_do_not_depend_on_other_seen_agents(
    method: str, seen: list[tuple[int, int]], width: int, data: st.DataObject
) -> None:
    observers, others = (
        (np.array(each, np.intp) for each in zip(*seen, strict=True)) if seen else (np.empty(0, int),) * 2
    )
    kept = np.array(data.draw(st.lists(st.booleans(), min_size=len(seen), max_size=len(seen))), bool)
    every, some = (GroupChance(7, "component sense", NUMBERS[:6]).at(Turn(3)) for _ in range(2))
    everybody = getattr(every, method)(observers, NUMBERS[others], width)
    assert everybody.shape == (len(seen), width)
    fewer = getattr(some, method)(observers[kept], NUMBERS[others[kept]], width)
    assert fewer.tobytes() == np.ascontiguousarray(everybody[kept]).tobytes()
    assert len(np.unique(everybody)) == everybody.size


def test_more_numbers_than_are_scrambled_at_a_time_are_those_of_smaller_draws() -> None:
    many = agent_numbers([f"a{number}" for number in range(10_000)])
    zeros = np.zeros(len(many), np.uint64)
    for drawing, width in ((uniform, 2), (standard_normal, 4)):
        whole = drawing(many, zeros, 5, width)
        parts = [drawing(many[place : place + 7], zeros[place : place + 7], 5, width) for place in (0, 4093, 9990)]
        for place, part in zip((0, 4093, 9990), parts, strict=True):
            assert part.tobytes() == whole[place : place + 7].tobytes()
        assert drawing(many, zeros, 5, 1).tobytes() == np.ascontiguousarray(whole[:, :1]).tobytes()


def test_seed_purpose_turn_and_repetition_all_count() -> None:
    keys = [(7, "a", 3, 0), (8, "a", 3, 0), (7, "b", 3, 0), (7, "a", 4, 0), (7, "a", 3, 1), (7, "a", 3, -1)]
    groups = [GroupChance(seed, purpose, NUMBERS[:1]).at(Turn(*turn)) for seed, purpose, *turn in keys]
    assert len({each.uniform(1).item() for each in groups}) == len(keys)
    agents = [AgentChance(seed, purpose).at(Turn(*turn)) for seed, purpose, *turn in keys]
    assert len({each.random() for each in agents}) == len(keys)


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 20), st.booleans()), max_size=12))
def test_an_agents_generator_begins_anew_in_each_turn_however_much_was_drawn(plan: list[tuple[int, int, bool]]) -> None:
    source, drawn = AgentChance(7, "agents.robot.0.steer"), {}
    instant = 0
    for passed, count, whole in plan:
        if passed:
            instant += passed
            drawn[instant] = generator(7, "agents.robot.0.steer", Turn(instant))
        expected = drawn.setdefault(instant, generator(7, "agents.robot.0.steer", Turn(instant)))
        random = source.at(Turn(instant))
        if whole:
            # Numbers of 32 bits leave half a word for the next.
            kept: Any = random.integers(0, 9, count, dtype=np.int32), expected.integers(0, 9, count, dtype=np.int32)
        else:
            kept = random.standard_normal(count), expected.standard_normal(count)
        assert kept[0].tolist() == kept[1].tolist()


@pytest.mark.parametrize("drawn", [0, 3])
def test_draws_continue_in_another_process_within_a_turn(drawn: int) -> None:
    agent, group = AgentChance(7, "a"), GroupChance(7, "a", NUMBERS[:2])
    agent.at(Turn(3)).random(drawn)
    for _ in range(drawn):
        group.at(Turn(3)).uniform(1)
    there = pickle.loads(pickle.dumps((agent, group)))
    for turn in (Turn(3), Turn(4)):
        assert agent.at(turn).random(3).tolist() == there[0].at(turn).random(3).tolist()
        assert group.at(turn).uniform(3).tolist() == there[1].at(turn).uniform(3).tolist()


@pytest.mark.parametrize("count", [1, 3, 200])
@given(
    st.lists(st.tuples(st.sampled_from([1, 1, 1, 2, 5]), st.booleans(), st.booleans()), max_size=60), st.integers(1, 4)
)
def test_draws_ahead_of_turns_equal_draws_in_them(count: int, plan: list[tuple[int, bool, bool]], width: int) -> None:
    group, rows = GroupChance(7, "component sense", NUMBERS[:count]), np.arange(count)
    instant = 0
    for passed, same, twice in plan:
        instant += 50_000_000 * passed
        others = NUMBERS[rows if same else count - 1 - rows]
        turns = [Turn(instant), Turn(instant, 1)] if twice else [Turn(instant)]
        for turn in turns:
            fresh = GroupChance(7, "component sense", NUMBERS[:count])
            found, expected = (
                (
                    each.at(turn).standard_normal(width),
                    each.standard_normal_of(rows, others, width),
                    each.uniform_of(rows[::2], others[::2], 1, "dropout"),
                )
                for each in (group, fresh)
            )
            for one, other in zip(found, expected, strict=True):
                assert one.tobytes() == other.tobytes()
                one[:] = 0.0  # whoever gets it may write in it
