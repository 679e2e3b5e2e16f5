"""Formats of files with the results of a command, such as JUnit's."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symaware_cli.entry_points import PluginError
from symaware_cli.evidence.results.result_case import ResultCase
from symaware_cli.log import whole_file
from symaware_cli.world import InstalledPlugins, PluginKind, UserError, code_position, describe


class ResultFormat(ABC):
    """A format of files with test cases. A plugin derives from it; it is registered in ``symaware.results``."""

    @abstractmethod
    def content(self, cases: Sequence[ResultCase], command: str) -> str:
        """Return the content of the file.

        Args:
            cases: The test cases, in the order in which they were decided. Texts are of any origin: names in a scenario
                may contain anything that is text, control characters included.
            command: The command that decided them, such as ``check``.
        """


RESULT = PluginKind("result", "symaware.results", (ResultFormat,))


@dataclass(frozen=True, slots=True)
class ResultFile:
    """A file with the results of a command.

    Attributes:
        form: Its format.
        path: Its path.
        origin: The plugin of the format, for messages.
    """

    form: ResultFormat
    path: Path
    origin: str

    @classmethod
    def named(cls, text: str) -> ResultFile:
        """Return the file that ``FORMAT:FILE`` names; it is not written yet.

        Raises:
            UserError: The text has another form, or the folder of the file does not exist.
            PluginError: There is no such format, or it cannot be used.
        """
        name, colon, path = text.partition(":")
        if not (name and colon and path):
            raise UserError(f"--results takes FORMAT:FILE, such as junit:results.xml, not `{text}`")
        installed = InstalledPlugins([RESULT])
        form: Any = installed.load(RESULT.name, name)()
        (listing, *_) = sorted(installed.find(name), key=lambda each: not each.built_in)
        folder = os.path.dirname(path) or os.curdir
        if not os.path.isdir(folder):
            raise UserError(f"--results {text}: there is no folder {folder}")
        return cls(form, Path(path), listing.origin)

    def write(self, cases: Sequence[ResultCase], command: str) -> None:
        """Write the file; an existing one is replaced.

        Raises:
            PluginError: The format fails.
            LogError: The path is that of a folder or a device.
            OutputError: The file cannot be written.
        """
        try:
            content = self.form.content(cases, command).encode("utf-8", "backslashreplace")
        except Exception as error:
            text = describe(error) + code_position(error, beyond=__file__)
            raise PluginError("failed-plugin", f"{self.origin} fails: {text}") from error
        with whole_file(self.path) as partial:
            partial.write_bytes(content)
