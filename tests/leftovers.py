"""Resources that a test may leave behind in its process: descriptors, threads, memory.

Resources of an earlier test may vanish between two counts, so a test asserts that there are no more than before.
"""

import ctypes
import gc
import os
import sys
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


class _Mallinfo(ctypes.Structure):
    """What glibc tells of its heaps (mallinfo2)."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            *("arena", "ordblks", "smblks", "hblks", "hblkhd"),
            *("usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"),
        )
    ]


def allocated() -> int:
    """How much memory is allocated in this process [bytes].

    Unlike the resident memory, it does not depend on the size of pages, and on when allocators take them. Where the C
    library does not tell, it is the resident memory.
    """
    tell = getattr(ctypes.CDLL(None), "mallinfo2", None)
    if tell is None:
        return resident()
    tell.restype = _Mallinfo
    found = tell()
    # Small objects of Python are in blocks of at most 512 bytes.
    return int(found.uordblks + found.hblkhd) + 64 * sys.getallocatedblocks()


def grows_forever(action: Callable[[], object], repeats: int, each: int) -> bool:
    """Whether the memory of this process never stops growing while an action is repeated.

    A leak grows in every round. What is kept once, such as a cache, does not, so there is no leak as soon as three
    rounds in a row need next to nothing.

    Args:
        action: The action that may leak.
        repeats: How often it is done in a round.
        each: What a repeat must leave behind to be called a leak [bytes].
    """
    held = [allocated()]
    for _ in range(15):
        for _ in range(repeats):
            action()
        gc.collect()
        held.append(allocated())
        if len(held) > 4 and held[-1] - held[-4] < 3 * repeats * each:
            return False
    return True
