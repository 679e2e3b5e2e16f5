"""A worker process of a pool, which computes requested results one after the other.

Its two pipes carry JSON, one value per line. The first line it reads describes the work; each further line is a block.
It writes a list of differences from the code of the requesting machine, which is empty if it is ready, and then one
line for each result, or for the error that prevents further results.
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
    """Serve the process that started this one as a worker."""
    setup = json.loads(requests.readline() or "null")
    if setup is None:
        return
    blocks: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(requests, blocks), daemon=True).start()
    # Imported after the path is set, while the parent process continues with other work.
    from symaware_cli.language import ScenarioError
    from symaware_cli.log import OutputError
    from symaware_cli.studies.executor import Block, described_work
    from symaware_cli.studies.sweep_error import SweepError

    work = described_work(setup["work"])
    work.open()
    _tell(answers, [] if setup["code"] is None else _differences(setup["code"], work))
    # Keeps modules that are already imported out of later garbage collections.
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
    """Return the differences from another machine's code, after importing everything that a run needs."""
    from symaware_cli.studies.identity import CodeIdentity

    work.prepare()
    return CodeIdentity(**code).differences(CodeIdentity.of_this_process())


def _listen(requests: BinaryIO, blocks: queue.SimpleQueue[dict[str, Any]]) -> None:
    """Read blocks until the pipe is closed, then kill the process, even during a run."""
    for line in requests:
        blocks.put(json.loads(line))
    os.kill(os.getpid(), signal.SIGKILL)


def _tell(answers: BinaryIO, content: Any) -> None:
    answers.write(json.dumps(content).encode() + b"\n")
    answers.flush()
