"""A worker process of a pool: makes the results that it is told to, one after the other.

What goes through its two pipes is JSON, one value a line. The first line it reads says what the work is; each further
one is a block of it. It writes a list of what differs from the code of the machine that asks, which is empty if it is
ready, and then a line for each result, or for the error that keeps it from making more.
"""

from __future__ import annotations

import gc
import json
import os
import queue
import signal
import sys
import threading
from typing import TYPE_CHECKING, Any, BinaryIO

from symaware_cli.runtime.worker import end_with

if TYPE_CHECKING:
    from symaware_cli.study.executor import Work


def main() -> None:
    """Be a worker of the process that started this one."""
    # Signals are for whoever started it; it ends with that.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    requests, answers = _taken_over()
    setup = json.loads(requests.readline() or "null")
    if setup is None or not end_with(setup["parent"]):
        return
    if setup["code"] is None:
        sys.path[:] = setup["path"]
    blocks: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(requests, blocks), daemon=True).start()
    # Imported with the path in place, and while whoever started it does something else.
    from symaware_cli.scenario.problem import ScenarioError
    from symaware_cli.study.executor import Block
    from symaware_cli.study.sweep_error import SweepError

    work = _made_again(setup["work"])
    work.open()
    _tell(answers, [] if setup["code"] is None else _differences(setup["code"], work))
    # What is imported by now need not be searched whenever the objects of past runs are collected.
    gc.freeze()
    while True:
        block = blocks.get()
        values = tuple(block["values"])
        try:
            for result in work.results(Block(tuple(block["indices"]), block["is_recorded"], values)):
                _tell(answers, {"index": result.index, "result": result.to_json()})
        except (ScenarioError, SweepError) as error:
            _tell(answers, {"error": str(error)})


def _made_again(content: dict[str, Any]) -> Work[Any]:
    """Return the work of which another process sent `Work.to_json`."""
    kind, content = content["kind"], {name: each for name, each in content.items() if name != "kind"}
    if kind == "sweep":
        from symaware_cli.study.folder import SweepWork

        return SweepWork(**content)
    if kind == "candidates":
        from symaware_cli.study.search_space import CandidateWork

        return CandidateWork(**content)
    from symaware_cli.study.splitting import RepeatWork, SplittingPlan

    return RepeatWork(SplittingPlan.from_json(content["plan"]))


def _differences(code: dict[str, Any], work: Work[Any]) -> list[str]:
    """Say how the code here differs from that of another machine, once everything for a run is imported."""
    from symaware_cli.study.identity import CodeIdentity

    work.prepare()
    return CodeIdentity(**code).differences(CodeIdentity.of_this_process())


def _taken_over() -> tuple[BinaryIO, BinaryIO]:
    """Take the standard streams for requests and answers: what plugins print goes to stderr."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    os.dup2(2, 1)
    return requests, answers


def _listen(requests: BinaryIO, blocks: queue.SimpleQueue[dict[str, Any]]) -> None:
    """Read blocks until there is nobody any more who sends some: then the process ends, whatever it does."""
    for line in requests:
        blocks.put(json.loads(line))
    os.kill(os.getpid(), signal.SIGKILL)


def _tell(answers: BinaryIO, content: Any) -> None:
    answers.write(json.dumps(content).encode() + b"\n")
    answers.flush()


if __name__ == "__main__":
    main()
