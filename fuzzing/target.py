"""The base class of fuzzing targets, which generate and run cases."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from random import Random
from typing import ClassVar


class Finding(Exception):  # noqa: N818 (what one looks for is not an error of the tool)
    """Something that must not happen.

    Attributes:
        kind: One word: `traceback`, `hang`, `memory`, `unreadable`, `crash`, or one defined by the target.
        where: Identifies the cause; findings of the same kind and cause count as one.
    """

    def __init__(self, kind: str, text: str, where: str | None = None) -> None:
        super().__init__(text)
        self.kind = kind
        self.where = where if where is not None else text.splitlines()[0]


class Target(ABC):
    """A subject of fuzzing. Each worker has an instance.

    Attributes:
        time_limit: Wall time after which a case counts as hanging [s].
        memory_limit: The greatest increase of the process's memory by a case [bytes].
        address_space: The greatest address space of the worker and of each of its children [bytes].
        cases_per_worker: The number of cases after which the process is replaced.
    """

    time_limit: ClassVar[float] = 60.0
    memory_limit: ClassVar[int] = 512 << 20
    address_space: ClassVar[int] = 6 << 30
    cases_per_worker: ClassVar[int] = 500

    def prepare(self, folder: Path) -> None:  # noqa: B027 (most need nothing)
        """Prepare, once for each worker: import slow modules, write files for all cases.

        Args:
            folder: An empty folder that exists as long as the worker.
        """

    @abstractmethod
    def make(self, chance: Random) -> bytes:
        """Generate a case; equal generators give equal cases, in any worker."""

    @abstractmethod
    def attempt(self, case: bytes, folder: Path) -> Mapping[str, int]:
        """Run a case from `make` or from the corpus.

        Any exception is a finding; so is a process that dies, hangs, or needs too much memory.

        Args:
            case: The case.
            folder: An empty folder, which is the working directory and is deleted afterwards.

        Returns:
            Counts of outcomes, which are summed over all cases, such as ``{"refused": 1}``.
        """

    def shrunk(self, case: bytes, folder: Path) -> bytes:
        """Return a smaller case with the same finding, for the corpus; by default the case itself.

        Args:
            case: A case in which something was found.
            folder: An empty folder for files.
        """
        return case
