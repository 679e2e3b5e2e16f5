"""What a target is: where cases come from, and what it means to try one."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from random import Random
from typing import ClassVar


class Finding(Exception):  # noqa: N818 (what one looks for is not an error of the tool)
    """Something that must not happen.

    Attributes:
        kind: In a word: `traceback`, `hang`, `memory`, `unreadable`, `crash`, or a target's own.
        where: What tells it from findings of other causes; findings with one kind and one place count as one.
    """

    def __init__(self, kind: str, text: str, where: str | None = None) -> None:
        super().__init__(text)
        self.kind = kind
        self.where = where if where is not None else text.splitlines()[0]


class Target(ABC):
    """Something that is fuzzed. An instance is made in each worker.

    Attributes:
        time_limit: Wall time after which a case counts as hanging [s].
        memory_limit: How much one case may add to the memory of the process [bytes].
        address_space: The most that the worker and its children may map, each [bytes].
        cases_per_worker: After so many cases the process is replaced.
    """

    time_limit: ClassVar[float] = 60.0
    memory_limit: ClassVar[int] = 512 << 20
    address_space: ClassVar[int] = 6 << 30
    cases_per_worker: ClassVar[int] = 500

    def prepare(self, folder: Path) -> None:  # noqa: B027 (most need nothing)
        """Get ready, once for each worker: import what takes long, write what all cases share.

        Args:
            folder: Empty, and there as long as the worker.
        """

    @abstractmethod
    def make(self, chance: Random) -> bytes:
        """Make a case. Equal generators make equal cases, in any worker."""

    @abstractmethod
    def attempt(self, case: bytes, folder: Path) -> Mapping[str, int]:
        """Try a case; it may come from `make`, or be a file of the corpus.

        Whatever is raised is a finding; so is a process that dies, hangs, or needs too much memory.

        Args:
            case: It.
            folder: Empty; the present folder, and gone afterwards.

        Returns:
            What became of it, to be added up over all cases, such as ``{"refused": 1}``.
        """
