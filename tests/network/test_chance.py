"""Chance that is keyed by the link and the number of the message."""

import numpy as np
import pytest
from scipy import stats

from symaware_cli.network.chance import agent_keys, link_keys, philox, uniforms

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


def words(numbers):
    return [np.array([number], np.uint64) for number in numbers]


@pytest.mark.parametrize(("counter", "key", "expected"), KNOWN)
def test_philox_is_that_of_its_authors(counter, key, expected):
    assert tuple(int(word[0]) for word in philox(words(counter), words(key))) == expected


def keys(count, seed=7):
    agents = agent_keys(seed, [f"robot.{number}" for number in range(count)], "links")
    return link_keys(np.repeat(agents, count), np.tile(agents, count))


def test_all_links_have_keys_of_their_own():
    assert len(np.unique(keys(100))) == 100 * 100


def test_draws_are_uniform_along_a_link_across_links_and_between_the_four():
    along = uniforms(np.repeat(keys(1), 50_000), np.arange(50_000), 0)
    across = uniforms(keys(200), np.zeros(40_000, np.int64), 1)
    for drawn in (along, across):
        assert (drawn > 0).all()
        assert (drawn < 1).all()
        for each in drawn:
            assert stats.kstest(each, "uniform").pvalue > 1e-3
        correlation = np.corrcoef(drawn) - np.eye(4)
        assert np.abs(correlation).max() < 4 / np.sqrt(drawn.shape[1])
    # From one message of a link to the next, and from one link to its neighbour.
    assert abs(np.corrcoef(along[0, 1:], along[0, :-1])[0, 1]) < 4 / np.sqrt(50_000)
    assert abs(np.corrcoef(across[0, 1:], across[0, :-1])[0, 1]) < 4 / np.sqrt(40_000)


def test_a_draw_depends_on_seed_link_message_and_page_alone():
    some, all_keys = np.array([3, 17, 99]), keys(10)
    whole = uniforms(all_keys, np.arange(100), 0)
    assert (uniforms(all_keys[some], some.astype(np.int64), 0) == whole[:, some]).all()
    assert (uniforms(all_keys, np.arange(100), 1) != whole).all()
    assert (uniforms(keys(10, seed=8), np.arange(100), 0) != whole).all()


def test_another_agent_changes_nobody_elses_key():
    few, more = ["a", "b", "c"], ["a", "b", "b2", "c"]
    before, after = agent_keys(1, few, "links"), agent_keys(1, more, "links")
    assert before.tolist() == after[[0, 1, 3]].tolist()
    assert before.tolist() != agent_keys(1, few, "topology").tolist()
