"""Chance is keyed by the seed of the run and a path, and by nothing else."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.core.random import RowGenerators, generator

GOLDEN = {
    (0, "agents.robot.0.sense"): [0.31665166885401863, 0.04305441078717642],
    (7, "agents.robot.0.sense"): [0.6028095303341473, 0.3089772419514023],
    (7, "agents.robot.1.sense"): [0.2187355657069856, 0.6462159217567212],
    (2**63 - 1, "environment.wind"): [0.14508274517519337, 0.37865910576381734],
}
"""First drawn with version 0.1.0; whoever changes them makes every seed in the world mean something else."""


@pytest.mark.parametrize(("seed", "path"), GOLDEN)
def test_a_path_draws_what_it_always_drew(seed, path):
    assert generator(seed, path).random(2).tolist() == GOLDEN[seed, path]


def test_another_process_with_other_hashes_draws_the_same():
    code = (
        "from symaware_cli.core.random import generator; print(generator(7, 'agents.robot.0.sense').random(2).tolist())"
    )
    for hash_seed in ("1", "2"):
        drawn = subprocess.run(
            [sys.executable, "-c", code], env={"PYTHONHASHSEED": hash_seed}, capture_output=True, text=True, check=True
        )
        assert drawn.stdout.strip() == str(GOLDEN[7, "agents.robot.0.sense"])


def test_two_agents_draw_independently():
    draws = np.array([generator(7, f"agents.robot.{row}.sense").standard_normal(4000) for row in range(6)])
    correlation = np.corrcoef(draws) - np.eye(6)
    # Of 15 independent pairs of 4000 the largest is below 0.06 with a probability of more than 99.7 %.
    assert np.abs(correlation).max() < 0.06
    assert np.abs(draws.mean(axis=1)).max() < 0.06
    assert np.abs(draws.std(axis=1) - 1).max() < 0.05


def test_neither_drawing_nor_making_a_generator_touches_the_global_state():
    before = np.random.get_state()[1].tolist()  # noqa: NPY002 (the state that must not be touched)
    generator(7, "a").random(100)
    RowGenerators(7, ["a", "b"]).standard_normal(3)
    assert np.random.get_state()[1].tolist() == before  # noqa: NPY002


rows = st.integers(1, 6)
widths = st.integers(1, 3)
takes = st.integers(1, 12)
blocks = st.integers(1, 5)


@given(rows, widths, takes, blocks, st.sampled_from(["standard_normal", "uniform"]))
def test_drawing_for_a_group_equals_drawing_row_by_row(count, width, takes, block, kind):
    paths = [f"agents.robot.{row}.sense" for row in range(count)]
    source = RowGenerators(7, paths, block=block)
    drawn = np.array([getattr(source, kind)(width) for _ in range(takes)])
    method = {"standard_normal": "standard_normal", "uniform": "random"}[kind]
    for row, path in enumerate(paths):
        own = generator(7, f"{path}/{method}")
        expected = [getattr(own, method)(width) for _ in range(takes)]
        assert drawn[:, row].tolist() == np.array(expected).tolist()


@given(rows, rows, takes)
def test_adding_rows_changes_nobodys_draws(few, more, takes):
    paths = [f"agents.robot.{row}.sense" for row in range(few + more)]
    small, large = RowGenerators(7, paths[:few]), RowGenerators(7, paths)
    for _ in range(takes):
        assert small.standard_normal(2).tobytes() == large.standard_normal(2)[:few].tobytes()


def test_one_kind_of_draw_does_not_shift_another():
    plain, mixed = RowGenerators(7, ["a"]), RowGenerators(7, ["a"])
    for _ in range(5):
        mixed.uniform(3)
        assert plain.standard_normal(2).tolist() == mixed.standard_normal(2).tolist()


@given(st.lists(st.lists(st.integers(0, 9), min_size=3, max_size=3), max_size=12), blocks)
def test_who_draws_more_or_less_than_others_reads_on_in_its_own_stream(steps, block):
    paths = ["a", "b", "c"]
    source = RowGenerators(7, paths, block=block)
    own = [generator(7, f"{path}/standard_normal") for path in paths]
    for counts in steps:
        drawn = source.standard_normal_of(np.array(counts))
        expected = [number for each, count in zip(own, counts, strict=True) for number in each.standard_normal(count)]
        assert drawn.tolist() == expected


def test_what_was_drawn_stays_and_may_be_written_without_consequence():
    source, other = RowGenerators(7, ["a"], block=2), RowGenerators(7, ["a"], block=2)
    first = source.uniform(1)
    kept = first.copy()
    other.uniform(1)
    for _ in range(5):
        drawn = source.uniform(1)
        assert drawn.tolist() == other.uniform(1).tolist()
        drawn[:] = 0.0
    assert first.tolist() == kept.tolist()
