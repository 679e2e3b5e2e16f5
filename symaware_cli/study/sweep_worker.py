"""A worker process of a sweep: makes the runs that it is told to, one after the other, and tells the row of each.

What goes through its two pipes is JSON, one value a line. The first line it reads says where the sweep is; each further
one is a block of runs. It writes a list of what differs from the code of the machine that asks, which is empty if it is
ready, and then a line for each run.
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
    from symaware_cli.study.runner import Runner


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
    from symaware_cli.study.folder import SweepFolder

    folder = SweepFolder.opened(setup["folder"])
    runner = folder.runner(setup["batch"])
    _tell(answers, [] if setup["code"] is None else _differences(setup["code"], runner))
    # What is imported by now need not be searched whenever the objects of past runs are collected.
    gc.freeze()
    while True:
        block = blocks.get()
        for row in runner.rows(block["indices"], folder.logs if block["is_recorded"] else None):
            _tell(answers, row.to_json())


def _differences(code: dict[str, Any], runner: Runner) -> list[str]:
    """Say how the code here differs from that of another machine, once everything for a run is imported."""
    from symaware_cli.study.code_identity import CodeIdentity

    runner.prepare()
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
