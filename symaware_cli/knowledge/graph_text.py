"""Files that parameters name, read as carefully as scenario files, with problems at their places in these files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any, NoReturn

from symaware_cli.language import ScenarioError, TextSpan, name_scalar, parse_yaml, read_text

_SUFFIXES = (".yaml", ".yml", ".dot")


class GraphText:
    """The file of a transition system.

    Attributes:
        text: Its text, without a byte order mark.
    """

    def __init__(self, path: FilePath) -> None:
        """Read a file.

        Args:
            path: The file.

        Raises:
            ScenarioError: It cannot be read.
        """
        self._source = read_text(path, str(path), "a file of a transition system", _SUFFIXES)
        self._raise()
        self.text = self._source.text

    def names(self) -> Any:
        """Return the content of a YAML file as plain data, in which each value but null is text as it is written.

        Raises:
            ScenarioError: It is no valid YAML; contains every problem.
        """
        parse_yaml(self._source, name_scalar)
        self._raise()
        return None if self._source.root is None else self._source.root.plain()

    def refuse(self, message: str, line: int, column: int) -> NoReturn:
        """Refuse the file for a problem at a place, both from 1.

        Raises:
            ScenarioError: Always.
        """
        self._refuse(message, self._source.text_span(line, column, line, column + 1))

    def refuse_value(self, message: str, place: Sequence[str | int], *, key: bool = False) -> NoReturn:
        """Refuse a YAML file for a problem with the value, or the key, at a place in its data.

        Raises:
            ScenarioError: Always.
        """
        root = self._source.root
        self._refuse(message, None if root is None else root.nearest_span(tuple(place), key=key))

    def _refuse(self, message: str, span: TextSpan | None) -> NoReturn:
        self._source.report("unsuitable", message, span)
        raise ScenarioError(self._source.problems)

    def _raise(self) -> None:
        if self._source.problems:
            raise ScenarioError(self._source.problems)
