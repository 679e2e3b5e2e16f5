"""Files of a scenario: opens scenarios and logs to run again, and finds a path for the log."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
import weakref
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path, PurePosixPath

from symaware_cli.core import Environment, nanoseconds
from symaware_cli.language.build import Built, build
from symaware_cli.language.catalogue import Catalogue
from symaware_cli.language.changes import Changes

#: The attachment of a log from which it is run again.
RESOLVED = "resolved.yaml"

#: Characters with a special meaning in file names on some systems.
_SPECIAL = frozenset("\\:\0")

#: Errors for names that are invalid, or conflict with existing files.
_NO_FILE = (errno.ENAMETOOLONG, errno.ENOTDIR, errno.EEXIST, errno.EISDIR, errno.EINVAL, errno.EILSEQ)


def open_scenario(
    path: Path,
    changes: Changes | None = None,
    seed: int | None = None,
    world: Callable[[Environment], Environment] | None = None,
    statements: Path | None = None,
    catalogue: Catalogue | None = None,
    repeats_until: float | None = None,
) -> Built:
    """Build the scenario of a file or of a log.

    The run of a log gets the external inputs of the original run, such as commands of another program, from the log.
    With changes or another seed these would not fit, so inputs come from outside again.

    Args:
        path: The scenario or the log.
        changes: Values that replace those of the file, as for ``--set``.
        seed: A seed in place of the scenario's.
        world: Returns an environment to use in place of the scenario's; None to use that one.
        statements: A file of specifications to use in place of the scenario's.
        catalogue: The installed plugins, if they were listed before.
        repeats_until: The time [s] until which the run of a log is the same in spite of changes, so that it gets inputs
            from the log until then; None if they may act from the beginning.

    Raises:
        ScenarioError: The scenario has problems.
        LogError: The log cannot be read, or contains no scenario.
    """
    if path.suffix != ".mcap":
        return build(path, changes, seed, catalogue, world=world, statements=statements)
    folder, built = tempfile.mkdtemp(prefix="symaware-"), None
    try:
        file, written = extracted(path, Path(folder))
        built = build(file, changes, seed, catalogue, f"{path}:{RESOLVED}", world, statements)
        is_same = not changes and seed is None
        if is_same or repeats_until is not None:
            _repeat_inputs(built, path, None if is_same or repeats_until is None else nanoseconds(repeats_until))
    finally:
        if built is not None and len(built.files) > 1:
            # Its processes, and components that begin later or begin anew, read the scenario's other files there.
            weakref.finalize(built.simulation, shutil.rmtree, folder, ignore_errors=True)
        else:
            shutil.rmtree(folder, ignore_errors=True)
    return replace(built, files=written)


def _repeat_inputs(built: Built, log: Path, until: int | None) -> None:
    from symaware_cli.log import INPUTS, open_log

    original = open_log(log)
    if INPUTS in original.channels:
        built.simulation.inputs.repeat(original.inputs, until)


def extracted(log: Path, folder: Path) -> tuple[Path, dict[str, bytes]]:
    """Extract the scenario of a log, with its assets, to a folder.

    Args:
        log: The log.
        folder: The folder, which exists.

    Returns:
        The scenario file in the folder, and the files of the scenario as they were written.

    Raises:
        LogError: The log cannot be read, or contains no scenario.
    """
    from symaware_cli.log import LogError, open_log

    attachments = open_log(log).attachments
    resolved = attachments.get(RESOLVED)
    if resolved is None:
        raise LogError(f"{log} contains no scenario to run again")
    for name, content in attachments.items():
        _extract(name, content, folder)
    file = unused_path("resolved", folder, ".yaml")  # a file of the scenario may have that name
    file.write_bytes(resolved)
    prefix = "scenario/"
    written = {name.removeprefix(prefix): content for name, content in attachments.items() if name.startswith(prefix)}
    return file, written


def check_output(built: Built, path: Path, scenario: Path) -> None:
    """Check that a log would not overwrite a file that the scenario was read from, also under another name.

    Args:
        built: The built scenario.
        path: The path of the new log.
        scenario: The scenario file, or the log from which it was read.

    Raises:
        LogError: It would overwrite one.
    """
    files = [scenario, *(scenario.parent / name for name in built.files)]
    # Unlike those of `Path`, these functions are False of a path that cannot be reached; the log's writer says why.
    if os.path.exists(path) and any(os.path.exists(file) and path.samefile(file) for file in files):
        from symaware_cli.log import LogError

        raise LogError(f"{path} is a file of the scenario; the log needs another file")


def _extract(name: str, content: bytes, folder: Path) -> None:
    """Extract a file of the scenario, such as a mesh, from a log; other attachments are ignored."""
    inner = PurePosixPath(name)
    if inner.parts[:1] != ("scenario",) or ".." in inner.parts or not _SPECIAL.isdisjoint(name) or len(inner.parts) < 2:
        return
    path = folder.joinpath(*inner.parts[1:])
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except OSError as error:
        from symaware_cli.log import OutputError, reason

        if error.errno not in _NO_FILE:
            raise OutputError(f"cannot extract the scenario of the log to {folder}: {reason(error)}") from error


def unused_path(name: str, folder: Path = Path(), suffix: str = ".mcap") -> Path:
    """Return an unused path: ``name.mcap``, or ``name-2.mcap`` and so on."""
    path, number = folder / f"{name}{suffix}", 1
    while os.path.exists(path):
        number += 1
        path = folder / f"{name}-{number}{suffix}"
    return path
