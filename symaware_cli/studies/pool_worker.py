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
import threading
from typing import TYPE_CHECKING, Any, BinaryIO

if TYPE_CHECKING:
    from symaware_cli.studies.executor import Work


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Be a worker of the process that started this one."""
    setup = json.loads(requests.readline() or "null")
    if setup is None:
        return
    blocks: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(requests, blocks), daemon=True).start()
    # Imported with the path in place, and while whoever started it does something else.
    from symaware_cli.language import ScenarioError
    from symaware_cli.log import OutputError
    from symaware_cli.studies.executor import Block, described_work
    from symaware_cli.studies.sweep_error import SweepError

    work = described_work(setup["work"])
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
        except OutputError as error:
            _tell(answers, {"error": str(error), "is_output": True})
        except (ScenarioError, SweepError) as error:
            _tell(answers, {"error": str(error)})


def _differences(code: dict[str, Any], work: Work[Any]) -> list[str]:
    """Say how the code here differs from that of another machine, once everything for a run is imported."""
    from symaware_cli.studies.identity import CodeIdentity

    work.prepare()
    return CodeIdentity(**code).differences(CodeIdentity.of_this_process())


def _listen(requests: BinaryIO, blocks: queue.SimpleQueue[dict[str, Any]]) -> None:
    """Read blocks until there is nobody any more who sends some: then the process ends, whatever it does."""
    for line in requests:
        blocks.put(json.loads(line))
    os.kill(os.getpid(), signal.SIGKILL)


def _tell(answers: BinaryIO, content: Any) -> None:
    answers.write(json.dumps(content).encode() + b"\n")
    answers.flush()
