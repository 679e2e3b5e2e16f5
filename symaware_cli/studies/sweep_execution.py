"""Where the runs of a sweep are made.

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

#: Where runs are made if nothing else is said.
LOCAL = "local"


@dataclass(frozen=True, slots=True)
class SweepTask:
    """The runs of a sweep that are to be made.

    Attributes:
        folder: The folder of the sweep.
        address: Where, in the terms of the execution; empty for its default.
        jobs: How many runs at a time; 0 for as many as it decides.
        count: How many runs there are.
        batch: How many runs are made together at most, where that is possible; 1 for none, None for as many as fit.
    """

    folder: SweepFolder
    address: str
    jobs: int
    count: int
    batch: int | None


class SweepExecution(ABC):
    """Makes the runs of sweeps; registered in the group `symaware.executors`.

    A run has the same row wherever it is made, so the table of a sweep does not depend on the execution. Rows of
    processes that have other code must be refused (`symaware_cli.studies.identity` compares it).
    """

    @abstractmethod
    def executor(self, task: SweepTask) -> AbstractContextManager[Executor[Row]]:
        """Return what makes the runs, as a context that ends it.

        Raises:
            SweepError: The address is wrong, or nothing answers there.
        """


EXECUTOR = PluginKind("executor", "symaware.executors", (SweepExecution,))


def execution_at(place: str | None) -> tuple[SweepExecution, str]:
    """Return the execution that a place names, and the rest of the place, which is its address.

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
