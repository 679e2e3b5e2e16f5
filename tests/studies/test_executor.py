"""Blocks: the runs that are distributed together. Signals: when they interrupt work."""

import os
import signal
from pathlib import Path
from typing import Any

import pytest
from sweeping import children

from symaware_cli.evidence.rare_event import RareEvent
from symaware_cli.evidence.splitting import RepeatWork, SplittingPlan
from symaware_cli.studies.executor import Blocks, signals_deferred, signals_raised
from symaware_cli.studies.identity import CodeIdentity
from symaware_cli.studies.worker_pool import WorkerPool


@pytest.mark.parametrize(("run_time", "least", "sizes"), [(0.1, 1, [10, 10]), (5.0, 1, [1, 1]), (5.0, 32, [32, 32])])
def test_a_block_takes_about_a_second_or_has_the_size_of_a_batch(run_time: float, least: int, sizes: list[int]) -> None:
    blocks = Blocks(range(1000), 1000, run_time=run_time, least=least)
    taken = [block.indices for _ in sizes if (block := blocks.take())]
    assert [len(each) for each in taken] == sizes
    assert [index for each in taken for index in each] == list(range(sum(sizes)))


def test_the_last_runs_are_shared_among_all_workers() -> None:
    blocks = Blocks(range(10), 10, least=100)
    block = blocks.take(share=3)
    assert block is not None
    assert len(block.indices) == 4


def test_returned_runs_are_taken_first() -> None:
    blocks = Blocks(range(4), 4, least=2)
    block = blocks.take()
    assert block is not None
    blocks.give_back(block.indices[1:])
    again = blocks.take()
    assert again is not None
    assert again.indices == (1, 2)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_deferred_signal_interrupts_at_the_end_of_the_block(number: int) -> None:
    made = []

    def work() -> None:
        with signals_deferred():
            signal.raise_signal(number)
            made.append("the rest of the block")
        made.append("what follows")

    with signals_raised(), pytest.raises(KeyboardInterrupt):
        work()
    assert made == ["the rest of the block"]


class Interrupting(CodeIdentity):
    """The code of this process, which raises an interrupt when it is sent to a worker that was just started."""

    __slots__ = ()

    def to_json(self) -> dict[str, Any]:
        signal.raise_signal(signal.SIGTERM)
        return super().to_json()


def test_a_worker_interrupted_during_its_start_is_ended_with_the_others() -> None:
    before = len(children(os.getpid()))
    work = RepeatWork(SplittingPlan(Path("walk.yaml"), (), RareEvent("far", "satisfied"), 2, 0))
    pool = WorkerPool(work, 1, code=Interrupting({}, {}, {}))
    with signals_raised(), pytest.raises(KeyboardInterrupt):
        [*pool.results(Blocks([0], 1))]
    pool.close()
    assert len(children(os.getpid())) == before
