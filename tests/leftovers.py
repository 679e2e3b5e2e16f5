"""What a test may leave behind in its process: descriptors, threads, memory.

What an earlier test left may vanish between two counts, so a test asserts that there is no more than before.
"""

import os
import threading
from pathlib import Path


def descriptors() -> int:
    """How many files and sockets this process has open."""
    return len(os.listdir("/proc/self/fd"))


def tasks() -> int:
    """How many threads this process has, those of libraries included."""
    return len(os.listdir("/proc/self/task"))


def threads() -> list[str]:
    """The threads of transports that are alive."""
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("symaware")]


def resident() -> int:
    """How much memory this process has [bytes]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
