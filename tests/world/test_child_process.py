"""A child process has this one's environment, and ends with it for any reason."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import pytest
from child_processes import is_running

from symaware_cli import processor
from symaware_cli.world.child_process import PythonChild, how_it_ended, read, write

TARGETS = {
    "the turns of components": "symaware_cli.engine.runtime.worker:serve",
    "the runs of a sweep": "symaware_cli.studies.pool_worker:serve",
    "rows of environments": "symaware_cli.learning.row_worker:serve",
    "a strategy": "symaware_cli.knowledge.synthesis.strategy_process:serve",
}

STARTS = """
import sys, time
from symaware_cli.world.child_process import PythonChild
child = PythonChild({target!r}, own_session=True)
print(child._process.pid, flush=True)
time.sleep(60)
"""


def echo(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer each request with the environment of this process."""
    while True:
        try:
            said = read(requests)
        except EOFError:
            return
        print("printed", flush=True)
        if said == b"die":
            os.kill(os.getpid(), signal.SIGKILL)
        write(answers, f"{said.decode()} {os.environ.get('OPENBLAS_CORETYPE')} {os.getcwd()}".encode())


@pytest.fixture
def child(monkeypatch: pytest.MonkeyPatch) -> Iterator[PythonChild]:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    made = PythonChild("test_child_process:echo")
    yield made
    made.kill()
    made.close()


def test_it_computes_with_the_kernels_of_this_process(child: PythonChild) -> None:
    write(child.requests, b"hello")
    kernel = processor.environment().get("OPENBLAS_CORETYPE")
    assert read(child.answers).decode() == f"hello {kernel} {os.getcwd()}"


def test_its_output_goes_to_the_standard_error_stream(child: PythonChild, capfd: pytest.CaptureFixture[str]) -> None:
    write(child.requests, b"hello")
    read(child.answers)
    out, _ = capfd.readouterr()
    assert out == ""


def test_the_end_of_a_process_is_described(child: PythonChild) -> None:
    write(child.requests, b"die")
    with pytest.raises(EOFError):
        read(child.answers)
    assert how_it_ended(child.close()) == "was killed by SIGKILL"
    assert how_it_ended(3) == "ended with exit status 3"
    assert how_it_ended(-99) == "was killed by signal 99"


def test_ctrl_c_does_not_end_it(child: PythonChild) -> None:
    write(child.requests, b"ready")
    read(child.answers)
    child._process.send_signal(signal.SIGINT)
    write(child.requests, b"still there")
    assert read(child.answers).startswith(b"still there")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not end children with their parents")
@pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS.keys())
def test_it_is_killed_with_the_process_that_started_it(target: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", STARTS.format(target=target)], stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        number = int(parent.stdout.readline())
        assert Path(f"/proc/{number}").exists()
        parent.kill()
    deadline = time.monotonic() + 30
    while is_running(number) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not is_running(number)
