"""Files that appear whole or not at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from symaware_cli.recording.error import LogError, OutputError, reason


@contextmanager
def whole_file(path: str | os.PathLike[str], *sources: Path) -> Iterator[Path]:
    """Write a file that takes its place only when it is complete.

    Args:
        path: Where it is to be; a file that is there already stays as it is until then.
        sources: What it is made of, which must not be overwritten.

    Yields:
        A path in the same folder, with the same suffix, to write to.

    Raises:
        OutputError: It cannot be written (no such folder, no permission, disk full); nothing is left behind.
        LogError: The path is that of a folder, of a device, or of a source.
    """
    path = Path(path)
    with _refusals_told(path):
        if path.exists() and not path.is_file():
            # A device above all: root may replace it by a file.
            raise LogError(f"cannot write {path}: it is {'a folder' if path.is_dir() else 'not a file'}")
        if path.exists() and any(source.exists() and path.samefile(source) for source in sources):
            raise LogError(f"cannot write {path}: it is what is read")
        with _placed(path) as partial:
            yield partial


@contextmanager
def whole_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write a folder that takes its place only when everything in it is complete.

    Args:
        path: Where it is to be. It may exist if it is empty.

    Yields:
        An empty folder beside it to write to.

    Raises:
        OutputError: It cannot be written (no such folder, no permission, disk full); nothing is left behind.
        LogError: Something is there already.
    """
    path = Path(path)
    with _refusals_told(path):
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise LogError(f"cannot write {path}: there is something already")
        with _placed(path) as partial:
            partial.mkdir()
            yield partial


@contextmanager
def _refusals_told(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"cannot write {path}: {reason(error)}") from error


@contextmanager
def _placed(path: Path) -> Iterator[Path]:
    """Yield a path beside another; what is there afterwards takes the other's place, unless something was raised."""
    # `.` and `..` have no name of their own, and are found only by resolving them.
    path = path if path.name.strip(".") else path.resolve()
    partial = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        # After os.replace there is nothing left to remove.
        with suppress(OSError):
            shutil.rmtree(partial) if partial.is_dir() else partial.unlink()
