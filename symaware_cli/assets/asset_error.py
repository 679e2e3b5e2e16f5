"""The error of a file that a shape refers to, with its place in that file."""

from __future__ import annotations


class AssetError(ValueError):
    """A file that a shape refers to cannot be used.

    Attributes:
        line: The line in the file, from 1; 0 if the problem has no place, as in binary files.
        column: The column, from 1; 0 if it is not known.
        file: The file with the problem, if the shape's file includes it; empty for the shape's file itself.
    """

    def __init__(self, message: str, line: int = 0, column: int = 0, file: str = "") -> None:
        super().__init__(message)
        self.line = line
        self.column = column
        self.file = file

    def located(self, name: str) -> str:
        """Return the message with its place, as in ``robot.urdf:3:8: the link `a` exists twice``."""
        place = ":".join(str(each) for each in (self.file or name, self.line, self.column) if each)
        return f"{place}: {self}"
