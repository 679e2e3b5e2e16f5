"""What a test may leave behind in its process: descriptors, threads, memory, worlds of PyBullet.

Something that an earlier test left is collected whenever Python likes. It is collected before anything is counted, so
that it cannot vanish between two counts.
"""

import gc
import os
import threading
from pathlib import Path


def descriptors() -> int:
    """How many files and sockets this process has open."""
    gc.collect()
    return len(os.listdir("/proc/self/fd"))


def tasks() -> int:
    """How many threads this process has, those of libraries included."""
    gc.collect()
    return len(os.listdir("/proc/self/task"))


def threads() -> list[str]:
    """The threads of transports that are alive."""
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("symaware")]


def resident() -> int:
    """How much memory this process has [bytes]."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def pybullet_clients() -> set[int]:
    """The numbers of the worlds of PyBullet that are open in this process."""
    import pybullet

    gc.collect()
    return {number for number in range(1024) if pybullet.getConnectionInfo(number)["isConnected"]}
