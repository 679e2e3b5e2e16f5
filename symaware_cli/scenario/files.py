"""Files around a scenario: what it is read from, be it a log, and where its own log may be."""

from __future__ import annotations

import errno
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

from symaware_cli.core import Environment
from symaware_cli.scenario.build import Built, build

#: The attachment that a log is run again from.
RESOLVED = "resolved.yaml"

#: Characters that mean something else in the names of files somewhere.
_SPECIAL = frozenset("\\:\0")

#: What is said of names that no file can have, or none beside those that are there.
_NO_FILE = (errno.ENAMETOOLONG, errno.ENOTDIR, errno.EEXIST, errno.EISDIR, errno.EINVAL, errno.EILSEQ)


def open_scenario(
    path: Path,
    overrides: Sequence[str] = (),
    seed: int | None = None,
    world: Callable[[Environment], Environment] | None = None,
    statements: Path | None = None,
) -> Built:
    """Build what a scenario file describes, or what a log is the record of.

    Args:
        path: The scenario or the log.
        overrides: What ``--set`` was given.
        seed: A seed that wins over the scenario's.
        world: Makes another environment that takes the place of the scenario's; None for that itself.
        statements: A file of specifications that take the place of the scenario's.

    Raises:
        ScenarioError: The scenario has problems.
        LogError: The log cannot be read, or holds no scenario.
    """
    if path.suffix != ".mcap":
        return build(path, overrides, seed, world=world, statements=statements)
    from symaware_cli.recording.error import LogError
    from symaware_cli.recording.reader import open_log

    attachments = open_log(path).attachments
    resolved = attachments.get(RESOLVED)
    if resolved is None:
        raise LogError(f"{path} holds no scenario to run again")
    with tempfile.TemporaryDirectory() as folder:
        extracted = Path(folder) / RESOLVED
        for name, content in attachments.items():
            _extract(name, content, Path(folder))
        extracted.write_bytes(resolved)
        built = build(extracted, overrides, seed, name=f"{path}:{RESOLVED}", world=world, statements=statements)
    written = {
        name.removeprefix("scenario/"): content for name, content in attachments.items() if name.startswith("scenario/")
    }
    return replace(built, files=written)


def check_output(built: Built, path: Path, scenario: Path) -> None:
    """Make sure that a log would replace no file that a scenario was read from, by whatever name.

    Args:
        built: The scenario.
        path: Where the log is to be.
        scenario: The scenario file, or the log it was taken from.

    Raises:
        LogError: It would.
    """
    files = [scenario, *(scenario.parent / name for name in built.files)]
    if path.exists() and any(file.exists() and path.samefile(file) for file in files):
        from symaware_cli.recording.error import LogError

        raise LogError(f"{path} is a file of the scenario; the log needs a file of its own")


def _extract(name: str, content: bytes, folder: Path) -> None:
    """Lay out a file of the scenario, such as a mesh; whatever else a log calls an attachment stays where it is."""
    inner = PurePosixPath(name)
    if inner.parts[:1] != ("scenario",) or ".." in inner.parts or not _SPECIAL.isdisjoint(name) or len(inner.parts) < 2:
        return
    if inner.parts[1] == RESOLVED:
        return  # that name is taken
    path = folder.joinpath(*inner.parts[1:])
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except OSError as error:
        from symaware_cli.recording.error import OutputError, reason

        if error.errno not in _NO_FILE:
            raise OutputError(f"cannot lay out the scenario of the log in {folder}: {reason(error)}") from error


def unused_path(name: str, folder: Path = Path(), suffix: str = ".mcap") -> Path:
    """Return a path for a file that overwrites none: ``name.mcap``, else ``name-2.mcap`` and so on."""
    path, number = folder / f"{name}{suffix}", 1
    while path.exists():
        number += 1
        path = folder / f"{name}-{number}{suffix}"
    return path
