"""Hands cases to workers, for as long as was asked for."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from multiprocessing.connection import wait
from pathlib import Path

from fuzzing.state import State
from fuzzing.worker import Result, Task, Worker

#: A worker stays with its target for so long [s], and what was done is kept so often.
SLICE = 30.0


def pursue(
    states: Mapping[str, State],
    *,
    minutes: float,
    cases: int | None,
    jobs: int,
    report: Callable[[str, Result], None],
) -> None:
    """Try cases until the time is up, or so many were done of each target.

    Wall time is shared equally among the targets. It may be interrupted at any time.

    Args:
        states: By name of the target.
        minutes: For how long.
        cases: How many of each target, those done earlier included; None for as many as there is time for.
        jobs: How many workers.
        report: Is told of what is new: the target's name, and what became of the case.
    """
    end, saved = time.monotonic() + minutes * 60, time.monotonic()
    spent = dict.fromkeys(states, 0.0)
    again = {name: list(state.pending) for name, state in states.items()}
    workers: list[_Job] = []

    def wanted(name: str) -> bool:
        state = states[name]
        return bool(again[name]) or cases is None or state.done + len(state.pending) < cases

    def task(name: str) -> Task:
        number = again[name].pop() if again[name] else states[name].take()
        return Task(number, f"{states[name].seed} {name} {number}")

    try:
        while True:
            now = time.monotonic()
            for job in [job for job in workers if not job.busy]:
                if now > end or now > job.until or job.worker.worn or not wanted(job.worker.target):
                    workers.remove(job)
                    job.worker.close()
                else:
                    job.start(task(job.worker.target))
            while now < end and len(workers) < jobs and (open_ := [name for name in states if wanted(name)]):
                # Of those that had the least time, the one that fewest workers are at.
                busy = [job.worker.target for job in workers]
                name = min(open_, key=lambda name: (busy.count(name), spent[name], name))
                workers.append(_Job(Worker(name), now + SLICE))
                workers[-1].start(task(name))
            if not workers:
                return
            for job, result in _results(workers):
                name = job.worker.target
                spent[name] += result.seconds
                if states[name].add(result):
                    report(name, result)
                if result.found:
                    # What it left behind might be the cause of the next one.
                    job.worker.close()
                    workers.remove(job)
            if time.monotonic() > saved + SLICE:
                saved = time.monotonic()
                for state in states.values():
                    state.save()
    finally:
        for job in workers:
            job.worker.close()
        for state in states.values():
            state.save()


def replay(name: str, files: Iterable[Path]) -> Iterator[tuple[Path, Result]]:
    """Try cases that stand in files, such as those of the corpus, in one worker for as long as nothing is found."""
    worker = Worker(name)
    try:
        for number, path in enumerate(files):
            job = _Job(worker, 0.0)
            job.start(Task(number, content=path.read_bytes()))
            results: list[tuple[_Job, Result]] = []
            while not results:
                results = _results([job])
            yield path, results[0][1]
            if results[0][1].found:
                worker.close()
                worker = Worker(name)
    finally:
        worker.close()


class _Job:
    """A worker, what it is at, and until when it stays with its target."""

    def __init__(self, worker: Worker, until: float) -> None:
        self.worker = worker
        self.until = until
        self.busy = False

    def start(self, task: Task) -> None:
        self.worker.start(task)
        self.busy = True


def _results(jobs: list[_Job]) -> list[tuple[_Job, Result]]:
    """Wait a moment for the cases of some workers, and end those that take too long."""
    ready = wait([job.worker.connection for job in jobs if job.busy], 0.2)
    results = []
    for job in [job for job in jobs if job.busy]:
        if job.worker.connection in ready:
            results.append((job, job.worker.result()))
        elif job.worker.overdue:
            results.append((job, job.worker.give_up()))
        else:
            continue
        job.busy = False
    return results
