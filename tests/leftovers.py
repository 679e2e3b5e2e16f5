"""Resources that a test may leave behind in its process: descriptors, threads, memory.

Resources of an earlier test may vanish between two counts, so a test asserts that there are no more than before.
"""

import gc
import os
import threading
from collections.abc import Callable
from pathlib import Path


def descriptors() -> int:
    """The number of open files and sockets of this process."""
    return len(os.listdir("/proc/self/fd"))


def tasks() -> int:
    """The number of threads of this process, including those of libraries."""
    return len(os.listdir("/proc/self/task"))


def threads() -> list[str]:
    """The threads of transports that are alive."""
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("symaware")]


def resident() -> int:
    """The memory of this process [bytes]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def grows_forever(action: Callable[[], object], repeats: int, each: int) -> bool:
    """Whether the memory of this process never stops growing while an action is repeated.

    A leak grows in every round. An allocator takes a few large pieces more, early on some machines and late on others,
    and then none, so there is no leak as soon as three rounds in a row need next to nothing.

    Args:
        action: The action that may leak.
        repeats: The number of repeats in a round.
        each: The memory that a repeat must leave behind to count as a leak [bytes].
    """
    held = [resident()]
    for _ in range(15):
        for _ in range(repeats):
            action()
        gc.collect()
        held.append(resident())
        if len(held) > 4 and held[-1] - held[-4] < 3 * repeats * each:
            return False
    return True
