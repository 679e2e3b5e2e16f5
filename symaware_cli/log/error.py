"""Errors of reading and writing logs."""

import errno
from collections.abc import Iterable

from symaware_cli.engine import RecordingError


class LogError(RecordingError):
    """A log cannot be written or read. The message is a sentence for users that names the file."""


class OutputError(LogError):
    """A log or a file made from one cannot be written: disk full, folder missing, permission denied."""

    status = 1


class UnknownNameError(LogError):
    """A requested name does not exist in a log.

    Attributes:
        name: The requested name.
        known: The existing names.
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
    errno.ENAMETOOLONG: "its name is too long",
    errno.ELOOP: "its links lead in a circle",
    errno.EIO: "the device failed",
    errno.ENODEV: "the device is gone",
    errno.ENXIO: "the device is gone",
}


_FAILING = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.ENODEV, errno.ENXIO)


def is_about_path(error: OSError) -> bool:
    """Whether another path would help: the error concerns neither the state of the disk nor its free space."""
    return error.errno not in _FAILING


def reason(error: OSError) -> str:
    """Explain an error of the operating system in plain words."""
    return _REASONS.get(error.errno or 0) or (error.strerror or str(error)).lower()
