"""What goes wrong with a log."""

import errno
from collections.abc import Iterable


class LogError(Exception):
    """A log cannot be written or read. The text is a sentence for people that names the file."""


class OutputError(LogError):
    """A log or what is made of it cannot be written: the disk is full, the folder is missing, permission is denied."""


class UnknownNameError(LogError):
    """Something is asked for that a log does not have.

    Attributes:
        name: What was asked for.
        known: What there is.
    """

    def __init__(self, message: str, name: str, known: Iterable[str]) -> None:
        super().__init__(message)
        self.name = name
        self.known = tuple(known)


_REASONS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file would be larger than allowed here",
    errno.EACCES: "permission denied",
    errno.EPERM: "permission denied",
    errno.EROFS: "the file system is read-only",
    errno.EISDIR: "it is a directory",
    errno.ENOENT: "its folder does not exist",
    errno.ENOTDIR: "part of its path is not a folder",
    errno.EIO: "the device failed",
    errno.ENODEV: "the device is gone",
    errno.ENXIO: "the device is gone",
}


def reason(error: OSError) -> str:
    """Say in plain words why the operating system refused."""
    return _REASONS.get(error.errno or 0) or (error.strerror or str(error)).lower()
