"""Blocks: which runs are given away together."""

import pytest

from symaware_cli.study.executor import Blocks


@pytest.mark.parametrize(("run_time", "least", "sizes"), [(0.1, 1, [10, 10]), (5.0, 1, [1, 1]), (5.0, 32, [32, 32])])
def test_a_block_is_worth_a_second_or_has_as_many_runs_as_are_made_together(
    run_time: float, least: int, sizes: list[int]
) -> None:
    blocks = Blocks(range(1000), 1000, run_time=run_time, least=least)
    taken = [block.indices for _ in sizes if (block := blocks.take())]
    assert [len(each) for each in taken] == sizes
    assert [index for each in taken for index in each] == list(range(sum(sizes)))


def test_all_take_part_in_the_rest() -> None:
    blocks = Blocks(range(10), 10, least=100)
    block = blocks.take(share=3)
    assert block is not None
    assert len(block.indices) == 4


def test_what_is_given_back_comes_first() -> None:
    blocks = Blocks(range(4), 4, least=2)
    block = blocks.take()
    assert block is not None
    blocks.give_back(block.indices[1:])
    again = blocks.take()
    assert again is not None
    assert again.indices == (1, 2)
