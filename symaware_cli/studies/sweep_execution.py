"""Executions of sweeps: where their runs are executed.

Reasons: docs/decisions/0070-executors-and-searches.md
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from dataclasses import dataclass

from symaware_cli.entry_points import PluginError
from symaware_cli.studies.executor import Executor
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.row import Row
from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.world import InstalledPlugins, PluginKind

#: The default execution.
LOCAL = "local"


@dataclass(frozen=True, slots=True)
class SweepTask:
    """The runs of a sweep to be executed.

    Attributes:
        folder: The folder of the sweep.
        address: The address, in the format of the execution; empty for its default.
        jobs: The number of concurrent runs; 0 to let the execution decide.
        count: The number of runs.
        batch: The maximum number of runs per batch; 1 for no batches, None for as many as fit in memory.
    """

    folder: SweepFolder
    address: str
    jobs: int
    count: int
    batch: int | None


class SweepExecution(ABC):
    """Makes the runs of sweeps; registered in the group `symaware.executors`.

    A run has the same row wherever it is executed, so the table of a sweep does not depend on the execution. Rows from
    processes with different code must be rejected (`symaware_cli.studies.identity` compares the code).
    """

    @abstractmethod
    def executor(self, task: SweepTask) -> AbstractContextManager[Executor[Row]]:
        """Return an executor of the runs, as a context manager that closes it.

        Raises:
            SweepError: The address is invalid, or nothing answers there.
        """


EXECUTOR = PluginKind("executor", "symaware.executors", (SweepExecution,))


def execution_at(place: str | None) -> tuple[SweepExecution, str]:
    """Return the execution named by a place, and the address that follows the name.

    Args:
        place: ``NAME`` or ``NAME:ADDRESS``, such as ``ray:10.0.0.1:6379``; None for this machine.

    Raises:
        SweepError: There is no execution of this name.
    """
    name, _, address = (place or LOCAL).partition(":")
    installed = InstalledPlugins([EXECUTOR])
    try:
        execution: SweepExecution = installed.load(EXECUTOR.name, name)()
    except PluginError as error:
        if error.code != "unknown-plugin":
            raise SweepError(str(error)) from error
        known = ", ".join(dict.fromkeys(listing.name for listing in installed.listings(EXECUTOR.name)))
        raise SweepError(f"there is no executor `{name}`; there are {known}") from None
    return execution, address
