"""Files that appear whole or not at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from symaware_cli.recording.error import LogError, reason


@contextmanager
def whole_file(path: str | os.PathLike[str], source: Path | None = None) -> Iterator[Path]:
    """Write a file that takes its place only when it is complete.

    Args:
        path: Where it is to be; what is there already stays as it is until then.
        source: What it is made of, which must not be overwritten.

    Yields:
        A path in the same folder, with the same suffix, to write to.

    Raises:
        LogError: It cannot be written (no such folder, no permission, disk full); nothing is left behind.
    """
    with _placed(Path(path), source) as partial:
        yield partial


@contextmanager
def whole_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write a folder that takes its place only when everything in it is complete.

    Args:
        path: Where it is to be. It may exist if it is empty.

    Yields:
        An empty folder beside it to write to.

    Raises:
        LogError: It cannot be written, or something is there already; nothing is left behind.
    """
    path = Path(path)
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise LogError(f"cannot write {path}: there is something already")
    with _placed(path, None) as partial:
        partial.mkdir()
        yield partial


@contextmanager
def _placed(path: Path, source: Path | None) -> Iterator[Path]:
    if source is not None and path.exists() and path.samefile(source):
        raise LogError(f"cannot write {path}: it is what is read")
    partial = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield partial
        if not partial.is_dir() and path.is_dir():
            raise LogError(f"cannot write {path}: it is a folder")
        os.replace(partial, path)
    except OSError as error:
        raise LogError(f"cannot write {path}: {reason(error)}") from error
    finally:
        # After os.replace there is nothing left to remove.
        with suppress(OSError):
            shutil.rmtree(partial) if partial.is_dir() else partial.unlink()
