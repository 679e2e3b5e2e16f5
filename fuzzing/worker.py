"""The worker process that runs cases, with bounded memory; it is ended if a case takes too long."""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import os
import resource
import shutil
import signal
import tempfile
import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random

from fuzzing.target import Finding
from fuzzing.targets import target

#: The greatest wall time of a case, in multiples of its time limit, however little CPU time it gets.
_PATIENCE = 4.0

#: The greatest time for starting a worker [s].
_START = 120.0

#: The package whose functions identify findings.
_OWN = "symaware_cli"


@dataclass(frozen=True, slots=True)
class Task:
    """A case to run.

    Attributes:
        number: Its number.
        seed: The seed of its generator.
        content: The case itself, if it is not generated.
    """

    number: int
    seed: str = ""
    content: bytes | None = None


@dataclass(frozen=True, slots=True)
class Found:
    """A finding, as sent between processes; see `Finding`."""

    kind: str
    where: str
    text: str


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a case.

    Attributes:
        number: The number of the case.
        seconds: Its wall time.
        memory: The peak increase of the process's memory [bytes].
        tally: The counts of the target.
        found: The finding, if there is one.
        case: The case, if there is a finding.
    """

    number: int
    seconds: float
    memory: int = 0
    tally: Mapping[str, int] = field(default_factory=dict)
    found: Found | None = None
    case: bytes = b""


class Worker:
    """A worker process for one target, as handled by the campaign."""

    def __init__(self, name: str) -> None:
        """Start the process.

        Args:
            name: The name of the target.
        """
        self.target = name
        self.limit = target(name).time_limit
        self.cases = 0
        self._folder = Path(tempfile.mkdtemp(prefix=f"fuzz-{name}-"))
        context = get_context("spawn")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(name, theirs, self._folder), daemon=True)
        self._process.start()
        theirs.close()
        self._task: Task | None = None
        self._began = self._start = self._used = 0.0

    @property
    def overdue(self) -> bool:
        """Whether its case takes too long; the limit of the first one includes the start of the worker.

        On an overloaded machine, a case that got CPU time for less than a quarter of its limit may take longer.
        """
        if self._task is None:
            return False
        taken, limit = time.monotonic() - self._began, self.limit + self._start
        return taken > _PATIENCE * limit or (taken > limit and self._cpu_time() - self._used > limit / 4)

    @property
    def worn(self) -> bool:
        """Whether the process has run enough cases to be replaced."""
        return self.cases >= target(self.target).cases_per_worker

    def start(self, task: Task) -> None:
        """Send a case to the process."""
        self._task, self._began = task, time.monotonic()
        self._start = 0.0 if self.cases else _START
        self._used = self._cpu_time()
        self.cases += 1
        with contextlib.suppress(BrokenPipeError):  # the process has died, which `result` reports
            self.connection.send(task)

    def result(self) -> Result:
        """Receive the result of the case, once the connection is readable; reports a crash if the process has died."""
        try:
            result: Result = self.connection.recv()
        except (EOFError, ConnectionError):
            self._process.join(10)
            code = self._process.exitcode or 0
            how = signal.Signals(-code).name if code < 0 else f"exit status {code}"
            return self._end("crash", f"the process died: {how}")
        self._task = None
        return result

    def give_up(self) -> Result:
        """End a case that takes too long, and the process with it."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._process.pid or 0, signal.SIGUSR1)  # print the traceback of all threads
        time.sleep(0.5)
        return self._end("hang", f"no end after {self.limit:g} s")

    def close(self) -> None:
        """End the process and all that it started."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid or 0, signal.SIGKILL)
        self._process.kill()
        self._process.join()
        self.connection.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _cpu_time(self) -> float:
        """The CPU time of the process [s]; 0 if it is unknown."""
        with contextlib.suppress(OSError, IndexError):
            fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
            return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        return 0.0

    def _end(self, kind: str, text: str) -> Result:
        """Close the process, and create the result that it cannot send itself."""
        task, seconds = self._task or Task(0), time.monotonic() - self._began
        self._task = None
        said = _read(self._folder / "output").decode(errors="replace")[-20_000:]
        case = _read(self._folder / "case")
        self.close()
        # faulthandler writes the innermost frame first.
        frames = [line.split("/")[-1] for line in said.splitlines() if "File " in line and f"/{_OWN}/" in line]
        where = f"{text}: {frames[0].strip() if frames else 'somewhere'}"
        return Result(task.number, seconds, found=Found(kind, where, f"{text}\n{said}"), case=case)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


def _serve(name: str, connection: Connection, folder: Path) -> None:
    """Run the cases received, until the connection is closed."""
    os.setsid()  # so that Ctrl-C reaches only the parent, and the process can be ended with its children
    output = os.open(folder / "output", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(output, stream)
    faulthandler.enable()
    faulthandler.register(signal.SIGUSR1, all_threads=True)
    tried = target(name)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (tried.address_space, tried.address_space))
    shared = folder / "shared"
    shared.mkdir()
    tried.prepare(shared)
    # Targets collect often, and need not look at what was imported each time.
    gc.collect()
    gc.freeze()
    while True:
        try:
            task: Task = connection.recv()
        except EOFError:
            return
        os.truncate(output, 0)
        here = folder / "here"
        here.mkdir()
        os.chdir(here)
        connection.send(_attempted(name, task, folder / "case", here))
        os.chdir(folder)
        shutil.rmtree(here, ignore_errors=True)


def _attempted(name: str, task: Task, copy: Path, here: Path) -> Result:
    tried = target(name)
    case, tally, found = task.content, {}, None
    before, began = _forget_peak(), time.monotonic()
    try:
        if case is None:
            case = tried.make(Random(task.seed))
        copy.write_bytes(case)
        tally = dict(tried.attempt(case, here))
    except Finding as finding:
        found = Found(finding.kind, finding.where, str(finding))
    except MemoryError as error:
        found = Found("memory", _place(error), traceback.format_exc())
    except (Exception, KeyboardInterrupt, SystemExit) as error:
        found = Found("traceback", _place(error), traceback.format_exc())
    seconds, memory = time.monotonic() - began, _peak() - before
    if found is None and memory > tried.memory_limit:
        found = Found("memory", f"over {tried.memory_limit >> 20} MB", f"{memory >> 20} MB more than before")
    return Result(task.number, seconds, memory, tally, found, (case or b"") if found else b"")


def _place(error: BaseException) -> str:
    """The innermost function of the package in a traceback, with the exception's class."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if f"/{_OWN}/" in frame.filename] or list(frames)
    where = f"{own[-1].filename.rpartition('/')[2]}:{own[-1].name}" if own else "somewhere"
    return f"{type(error).__name__} in {where}"


def _forget_peak() -> int:
    """Reset the peak of memory use, and return the present use [bytes]; Linux only."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    return _status("VmRSS")


def _peak() -> int:
    return _status("VmHWM")


def _status(key: str) -> int:
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith(key):
                return int(line.split()[1]) << 10
    return 0
