"""Files beside a scenario, as a knowledge model sees them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn, Protocol


class SideFile(Protocol):
    """A file that a parameter names, which the reader of scenario files has read.

    Attributes:
        text: Its text, without a byte order mark.
    """

    text: str

    def names(self) -> Any:
        """Return the content of a YAML file as plain data, in which each value but null is text as it is written.

        Raises:
            Exception: It is no valid YAML; contains every problem, with its place in the file.
        """

    def refuse(self, message: str, line: int, column: int) -> NoReturn:
        """Refuse the file for a problem at a place, both from 1.

        Raises:
            Exception: Always.
        """

    def refuse_value(self, message: str, place: Sequence[str | int], *, key: bool = False) -> NoReturn:
        """Refuse a YAML file for a problem with the value, or the key, at a place in its data.

        Raises:
            Exception: Always.
        """
