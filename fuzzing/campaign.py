"""A fuzzing campaign: distributes cases to workers until the time is up."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from multiprocessing.connection import wait
from pathlib import Path

from fuzzing.state import State
from fuzzing.worker import Result, Task, Worker

#: How long a worker runs cases of one target, and the interval at which the state is saved [s].
SLICE = 30.0


def pursue(
    states: Mapping[str, State],
    *,
    minutes: float,
    cases: int | None,
    jobs: int,
    report: Callable[[str, Result], None],
) -> None:
    """Run cases until the time is up, or a number of cases of each target is done.

    Wall time is shared equally among the targets. The campaign may be interrupted at any time.

    Args:
        states: The state of each target, by name.
        minutes: The duration.
        cases: The number of cases of each target, including earlier ones; None for no limit.
        jobs: The number of workers.
        report: Called with the target's name and the result of each case with a new finding.
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
                # The target with the fewest workers and, among these, with the least time so far.
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
                    # A new worker, because side effects of this case might cause the next finding.
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
    """Run cases from files, such as those of the corpus, in one worker until a finding, then in a new one."""
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
    """A worker, whether it is busy, and until when it runs cases of its target."""

    def __init__(self, worker: Worker, until: float) -> None:
        self.worker = worker
        self.until = until
        self.busy = False

    def start(self, task: Task) -> None:
        self.worker.start(task)
        self.busy = True


def _results(jobs: list[_Job]) -> list[tuple[_Job, Result]]:
    """Wait briefly for results of some workers, and end those that are overdue."""
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
