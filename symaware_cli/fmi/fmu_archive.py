"""The file of an FMU: a zip archive, which is checked before its content is used.

The layout is that of section 2.5 of the standard (https://fmi-standard.org/docs/3.0.2/#fmu-distribution).
"""

from __future__ import annotations

import hashlib
import stat
import zipfile
from pathlib import Path, PurePosixPath

MOST_BYTES = 64 << 20
"""The greatest size of an FMU [bytes]: the log of a run contains it."""
MOST_UNPACKED = 512 << 20
"""The greatest total size of the unpacked content [bytes]."""
MOST_ENTRIES = 10_000
DESCRIPTION = "modelDescription.xml"
_MOST_DESCRIPTION = 32 << 20
_PART = 1 << 20


class FmuError(Exception):
    """An FMU cannot be used; the message gives the reason."""


def check_archive(path: Path) -> str:
    """Check the file of an FMU, and return its SHA-256 in hexadecimal digits.

    Raises:
        FmuError: The file is too large, damaged, or has paths that lead out of the archive.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise FmuError(f"it has more than {MOST_BYTES >> 20} MiB")
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            _check_entries(entries)
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except (zipfile.BadZipFile, NotImplementedError, ValueError, UnicodeError, EOFError) as error:
        raise FmuError(f"it is no sound zip archive: {error}") from error
    except OSError as error:
        raise FmuError(f"it cannot be read: {error.strerror or error}") from error


def _check_entries(entries: list[zipfile.ZipInfo]) -> None:
    if len(entries) > MOST_ENTRIES:
        raise FmuError(f"it has more than {MOST_ENTRIES:,} entries")
    if sum(entry.file_size for entry in entries) > MOST_UNPACKED:
        raise FmuError(f"it unpacks to more than {MOST_UNPACKED >> 20} MiB")
    seen: set[str] = set()
    for entry in entries:
        name = entry.filename
        parts = PurePosixPath(name).parts
        if not parts or name.startswith("/") or ".." in parts or "\\" in name or ":" in parts[0] or "\0" in name:
            raise FmuError(f"its entry `{name[:60]}` leads out of it")
        kind = stat.S_IFMT(entry.external_attr >> 16)
        if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise FmuError(f"its entry `{name[:60]}` is a link or a device")
        if entry.flag_bits & 1:
            raise FmuError("it is encrypted")
        if str(PurePosixPath(name)) in seen:
            raise FmuError(f"it has two entries `{name[:60]}`")
        seen.add(str(PurePosixPath(name)))
        if name == DESCRIPTION and entry.file_size > _MOST_DESCRIPTION:
            raise FmuError(f"its {DESCRIPTION} is too long")
    if DESCRIPTION not in seen:
        raise FmuError(f"there is no {DESCRIPTION} in it")


def extract(path: Path, folder: Path) -> None:
    """Unpack a checked FMU, without relying on the sizes that the archive states.

    Raises:
        FmuError: The file has changed since the check, or is damaged.
    """
    check_archive(path)
    left = MOST_UNPACKED
    try:
        with zipfile.ZipFile(path) as archive:
            for entry in archive.infolist():
                at = folder / entry.filename
                if entry.is_dir():
                    at.mkdir(parents=True, exist_ok=True)
                    continue
                at.parent.mkdir(parents=True, exist_ok=True)
                with archive.open(entry) as packed, open(at, "wb") as file:
                    while part := packed.read(_PART):
                        left -= len(part)
                        if left < 0:
                            raise FmuError(f"it unpacks to more than {MOST_UNPACKED >> 20} MiB")
                        file.write(part)
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError) as error:
        raise FmuError(f"it is damaged: {error}") from error
