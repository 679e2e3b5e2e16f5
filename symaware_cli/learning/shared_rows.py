"""Memory that the processes of a vector environment share: the requests to rows, and their results."""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.learning.row_arrays import Array, RowArrays, RowSizes, Truths


class SharedRows(RowArrays):
    """The arrays of all rows in shared memory.

    The process of the environment writes the arrays of a request before it sends the request, and a worker process
    writes the results of its rows before it answers. So no element is written while another process reads it.

    Attributes:
        actions: The control inputs of a step; shape (rows, n, nu).
        given: Whether each agent gets its control input from `actions`; shape (rows, n).
        chosen: The rows that begin or step; shape (rows,).
        seeds: The seeds of the rows that begin; shape (rows,).
        made: The number of rows that each worker process has begun or stepped so far; shape (workers,).
    """

    def __init__(self, sizes: RowSizes, workers: int, descriptor: int) -> None:
        """Map the memory.

        Args:
            sizes: The sizes of the arrays.
            workers: The number of worker processes.
            descriptor: The file descriptor of the memory, from `shared_memory`.
        """
        shapes = _shapes(sizes, workers)
        memory = mmap.mmap(descriptor, _bytes(shapes))
        start = 0
        for name, (shape, kind) in shapes.items():
            count = int(np.prod(shape))
            setattr(self, name, np.frombuffer(memory, kind, count, start).reshape(shape))
            start += count * np.dtype(kind).itemsize

    actions: Array
    given: Truths
    chosen: Truths
    seeds: NDArray[np.int64]
    made: NDArray[np.int64]

    def part(self, rows: slice) -> RowArrays:
        """Return the results of some rows, as views."""
        found = RowArrays.__new__(RowArrays)
        for name in RowArrays.FIELDS:
            setattr(found, name, getattr(self, name)[rows])
        return found


@contextmanager
def shared_memory(sizes: RowSizes, workers: int) -> Iterator[int]:
    """Provide a file in memory for `SharedRows`, as a descriptor that other processes can inherit.

    The file has no name, so it vanishes when no process maps it any more, even if processes were killed.

    Raises:
        OSError: There is not enough memory.
    """
    size = _bytes(_shapes(sizes, workers))
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("symaware")
    else:
        with tempfile.TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    try:
        if hasattr(os, "posix_fallocate"):  # else a write beyond the available memory would end the process
            os.posix_fallocate(descriptor, 0, size)
        else:
            os.ftruncate(descriptor, size)
        yield descriptor
    finally:
        os.close(descriptor)


def _shapes(sizes: RowSizes, workers: int) -> dict[str, tuple[tuple[int, ...], Any]]:
    """Return the shape and the type of each array; those of eight bytes come first, so all are aligned."""
    rows, agents, observed, inputs = sizes
    return {
        "observations": ((rows, agents, observed), np.float64),
        "rewards": ((rows, agents), np.float64),
        "actions": ((rows, agents, inputs), np.float64),
        "seeds": ((rows,), np.int64),
        "made": ((workers,), np.int64),
        "terminated": ((rows, agents), np.bool_),
        "present": ((rows, agents), np.bool_),
        "given": ((rows, agents), np.bool_),
        "ended": ((rows,), np.bool_),
        "complete": ((rows,), np.bool_),
        "chosen": ((rows,), np.bool_),
    }


def _bytes(shapes: dict[str, tuple[tuple[int, ...], Any]]) -> int:
    return sum(int(np.prod(shape)) * np.dtype(kind).itemsize for shape, kind in shapes.values())
