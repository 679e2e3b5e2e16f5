"""Trust in files of plugins: for a command, or for a folder until one of its files changes.

Only a person can give trust. It is kept in the user's configuration folder, and handed to processes that this one
starts; no content of a scenario or a log affects it.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path, PurePosixPath
from typing import Any

from symaware_cli.plugin_files.file_set import MAX_FILES, MAX_SIZE, FileSet
from symaware_cli.world import UserError

#: The digests of files by their paths.
Digests = Mapping[str, str]

#: What a process hands to those that it starts: a JSON list of objects with the folder and the files of each set.
HANDED_DOWN = "SYMAWARE_PLUGIN_FILES"
_MOST_HANDED_DOWN = 16
_HANDED = {"folder", "named", "files"}

Judge = Callable[[FileSet], bool]

_judge: ContextVar[Judge | None] = ContextVar("judge", default=None)


class TrustError(UserError):
    """A folder cannot be trusted, or the list of trusted folders cannot be used."""

    status = 2


@contextmanager
def trusting(judge: Judge = lambda files: True) -> Iterator[None]:
    """Trust files of plugins of the scenarios that are built within the block, and afterwards in this process.

    Args:
        judge: Returns whether to trust some files; by default all.
    """
    token = _judge.set(judge)
    try:
        yield
    finally:
        _judge.reset(token)


def is_trusted(files: FileSet) -> bool:
    """Return whether a person trusts all of some files."""
    if any(_is_within(files.digests, each["files"]) for each in handed_down()):
        return True
    if any(_is_within(files.digests, each) for each in _kept().values()):
        return True
    judge = _judge.get()
    return judge is not None and judge(files)


def trusted_copy(digests: Digests) -> Mapping[str, bytes] | None:
    """Return the contents of files that are trusted here, by their digests; None if untrusted or unavailable."""
    sets = [(each["folder"], each["files"]) for each in handed_down()] + list(_kept().items())
    for folder, trusted in sets:
        for place in _places(digests, trusted):
            found = {}
            with suppress(OSError):
                for name, digest in digests.items():
                    content = Path(folder, place + name).read_bytes()
                    if hashlib.sha256(content).hexdigest() == digest:
                        found[name] = content
            if found.keys() == digests.keys():
                return found
    return None


def hand_down(files: FileSet) -> None:
    """Let processes that this one starts trust and find some files."""
    own = {"folder": str(files.folder), "named": files.named, "files": dict(files.digests)}
    others = [each for each in handed_down() if each["files"] != own["files"]]
    os.environ[HANDED_DOWN] = json.dumps([*others, own][-_MOST_HANDED_DOWN:])


def handed_down() -> list[dict[str, Any]]:
    """Return the sets of files that this process, or one that started it, has executed."""
    try:
        found = json.loads(os.environ.get(HANDED_DOWN) or "[]")
    except ValueError:
        return []
    return (
        [each for each in found if isinstance(each, dict) and each.keys() == _HANDED] if isinstance(found, list) else []
    )


def _is_within(files: Digests, trusted: Digests) -> bool:
    return next(_places(files, trusted), None) is not None


def _places(files: Digests, trusted: Digests) -> Iterator[str]:
    """Yield each folder below that of trusted files in which all of some files are, as the beginning of a path."""
    first = next(iter(files))
    for path in trusted:
        place = path.removesuffix(first)
        is_one = path == place + first and place[-1:] in ("", "/")
        if is_one and all(trusted.get(place + name) == digest for name, digest in files.items()):
            yield place


def remember(folder: Path) -> Digests:
    """Trust the Python files in a folder and below until one of them changes.

    Args:
        folder: The folder; hidden folders in it are left out.

    Returns:
        The digest of each file, by its path relative to the folder.

    Raises:
        TrustError: There are none or too many, or the list cannot be written.
    """
    if not folder.is_dir():
        raise TrustError(f"{folder} is not a folder")
    home = folder.resolve()
    found = dict(sorted(_python_files(home)))
    if not found:
        raise TrustError(f"{folder} has no Python files")
    _write({**_kept(), str(home): found})
    return found


def _python_files(home: Path) -> Iterator[tuple[str, str]]:
    count = 0
    for parent, folders, names in os.walk(home):
        folders[:] = sorted(each for each in folders if each.isidentifier() and each != "__pycache__")
        for name in sorted(names):
            path = Path(parent, name)
            if path.suffix != ".py" or not path.resolve().is_relative_to(home) or not path.is_file():
                continue
            count += 1
            if count > MAX_FILES or path.stat().st_size > MAX_SIZE:
                raise TrustError(
                    f"{home} has more than {MAX_FILES} Python files, or one of more than {MAX_SIZE:,} bytes: "
                    f"trust a folder with the scenario and its plugins only"
                )
            yield PurePosixPath(path.relative_to(home)).as_posix(), hashlib.sha256(path.read_bytes()).hexdigest()


def forget(folder: Path) -> bool:
    """Withdraw the trust in the files of a folder; return whether they were trusted.

    Raises:
        TrustError: The list cannot be written.
    """
    kept = dict(_kept())
    known = kept.pop(str(folder.resolve()), None) is not None
    if known:
        _write(kept)
    return known


def trusted_folders() -> Mapping[str, Digests]:
    """Return the digests of the files of each folder that is trusted, by its path."""
    return _kept()


def kept_folder() -> Path:
    """The folder of the user's configuration of SymAware."""
    if sys.platform == "win32":
        return Path(os.environ.get("APPDATA") or Path.home() / "AppData" / "Roaming", "symaware")
    given = Path(os.environ.get("XDG_CONFIG_HOME") or "")
    return (given if given.is_absolute() else Path.home() / ".config") / "symaware"


def _list() -> Path:
    return kept_folder() / "trusted.json"


def _kept() -> dict[str, dict[str, str]]:
    """Return the folders that are trusted; none if the list is damaged, so that trust is requested again."""
    try:
        content = json.loads(_list().read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(content, dict):
        return {}
    return {
        folder: files
        for folder, files in content.items()
        if isinstance(files, dict) and all(isinstance(each, str) for each in files.values())
    }


def _write(content: Mapping[str, Digests]) -> None:
    file = _list()
    partial = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        partial.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        partial.replace(file)
    except OSError as error:
        with suppress(OSError):
            partial.unlink()
        raise TrustError(f"cannot write {file}: {(error.strerror or str(error)).lower()}") from error
