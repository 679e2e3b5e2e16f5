"""Atomic output: files and folders that appear complete or not at all."""

import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from symaware_cli.log.error import LogError, OutputError, reason

#: The files and folders that were written since `outputs_noted` was entered.
_NOTED: ContextVar[list[Path] | None] = ContextVar("outputs", default=None)


@contextmanager
def outputs_noted() -> Iterator[list[Path]]:
    """Collect the files and folders that are written completely from now on, to report them after an interruption."""
    noted: list[Path] = []
    token = _NOTED.set(noted)
    try:
        yield noted
    finally:
        _NOTED.reset(token)


def note_output(path: Path) -> None:
    """Note that a file or folder is complete."""
    noted = _NOTED.get()
    if noted is not None and path not in noted:
        noted.append(path)


@contextmanager
def whole_file(path: str | os.PathLike[str], *sources: Path) -> Iterator[Path]:
    """Write a file that replaces the target only when it is complete.

    Args:
        path: The target; an existing file stays unchanged until then.
        sources: The input files, which must not be overwritten.

    Yields:
        An empty file in the same folder, with the same suffix, to write to.

    Raises:
        OutputError: It cannot be written (folder missing, permission denied, disk full); nothing is left behind.
        LogError: The path is a folder, a device, or an input file.
    """
    path = Path(path)
    with _os_errors_reported(path):
        _require_replaceable(path, sources)
        with _replacing(path) as partial:
            partial.touch()
            yield partial


@contextmanager
def whole_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write a folder that appears only when everything in it is complete.

    Args:
        path: The target. It may exist if it is empty.

    Yields:
        An empty folder beside it to write to.

    Raises:
        OutputError: It cannot be written (folder missing, permission denied, disk full); nothing is left behind.
        LogError: The target is not an empty folder.
    """
    path = Path(path)
    with _os_errors_reported(path):
        _require_empty(path)
        with _replacing(path) as partial:
            partial.mkdir()
            yield partial


def require_writable_file(path: str | os.PathLike[str], *sources: Path) -> None:
    """Check that `whole_file` could write a file, before the work whose result it is for.

    Raises:
        OutputError: It cannot be written.
        LogError: The path is a folder, a device, or an input file.
    """
    path = Path(path)
    with _os_errors_reported(path):
        _require_replaceable(path, sources)
        with _partial(path) as partial:
            partial.touch()


def require_writable_folder(path: str | os.PathLike[str]) -> None:
    """Check that `whole_folder` could write a folder, before the work whose results it is for.

    Raises:
        OutputError: It cannot be written.
        LogError: The target is not an empty folder.
    """
    path = Path(path)
    with _os_errors_reported(path):
        _require_empty(path)
        with _partial(path) as partial:
            partial.mkdir()


def _require_replaceable(path: Path, sources: Iterable[Path]) -> None:
    if path.exists() and not path.is_file():
        # Mainly for devices, which root could replace by a file.
        raise LogError(f"cannot write {path}: it is {'a folder' if path.is_dir() else 'not a file'}")
    if path.exists() and any(source.exists() and path.samefile(source) for source in sources):
        raise LogError(f"cannot write {path}: it is an input file")


def _require_empty(path: Path) -> None:
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise LogError(f"cannot write {path}: it is not an empty folder")


@contextmanager
def _os_errors_reported(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"cannot write {path}: {reason(error)}") from error


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside the target; on success, it replaces the target."""
    path = _named(path)
    with _partial(path) as partial:
        yield partial
        os.replace(partial, path)
        note_output(path)


@contextmanager
def _partial(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside the target, which is removed at the end."""
    path = _named(path)
    partial = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield partial
    finally:
        # After os.replace there is nothing left to remove.
        with suppress(OSError):
            shutil.rmtree(partial) if partial.is_dir() else partial.unlink()


def _named(path: Path) -> Path:
    """Resolve `.` and `..`, to which no suffix can be added."""
    return path if path.name.strip(".") else path.resolve()
