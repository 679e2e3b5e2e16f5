"""From a scenario that is sound to a run and its log."""

from __future__ import annotations

import errno
import json
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from symaware_cli import processor
from symaware_cli.core import Event, Level, nanoseconds
from symaware_cli.runtime.run import run
from symaware_cli.runtime.summary import Summary
from symaware_cli.scenario.build import Built, build
from symaware_cli.scenario.versions import versions

if TYPE_CHECKING:
    from symaware_cli.recording.writer import LogWriter
    from symaware_cli.scenario.place import Place

#: The attachment that a log is run again from.
RESOLVED = "resolved.yaml"

#: Characters that mean something else in the names of files somewhere.
_SPECIAL = frozenset("\\:\0")

#: What is said of names that no file can have, or none beside those that are there.
_NO_FILE = (errno.ENAMETOOLONG, errno.ENOTDIR, errno.EEXIST, errno.EISDIR, errno.EINVAL, errno.EILSEQ)

_MEDIA_TYPES = {".toml": "application/toml", ".yaml": "application/yaml", ".yml": "application/yaml"}


def open_scenario(path: Path, overrides: Sequence[str] = (), seed: int | None = None) -> Built:
    """Build what a scenario file describes, or what a log is the record of.

    Raises:
        ScenarioError: The scenario has problems.
        LogError: The log cannot be read, or holds no scenario.
    """
    if path.suffix != ".mcap":
        return build(path, overrides, seed)
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
        built = build(extracted, overrides, seed, name=f"{path}:{RESOLVED}")
    written = {
        name.removeprefix("scenario/"): content for name, content in attachments.items() if name.startswith("scenario/")
    }
    return replace(built, files=written)


def is_read(built: Built, path: Path, scenario: Path) -> bool:
    """Whether a path is one of the files that a scenario was read from, by whatever name.

    Args:
        built: The scenario.
        path: Where something is to be written.
        scenario: The scenario file, or the log it was taken from.
    """
    files = [scenario, *(scenario.parent / name for name in built.files)]
    return path.exists() and any(file.exists() and path.samefile(file) for file in files)


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


# Numbers that are not finite fail where they are written, with who wrote them; a warning of NumPy would only add noise.
@np.errstate(all="ignore")
def execute(
    built: Built,
    log: Path | None,
    on_progress: Callable[[int], None] | None = None,
    timeout: float | None = None,
    place: Place | None = None,
) -> Summary:
    """Run a scenario, or one process's share of it.

    Args:
        built: What to run; it cannot be run twice.
        log: Where to record it, or None for nowhere.
        on_progress: Called now and then with simulated time in nanoseconds.
        timeout: Wall time after which the run is ended [s].
        place: Where this process stands among those that share the run; None where it is alone.

    Raises:
        LogError: The log cannot be written.
        DistributionError: This process cannot have that place.
        TransportError: The others cannot be reached from there.

    Warns:
        ProcessorWarning: On another processor the run may differ in its last bits.
    """
    shortfall = processor.shortfall()
    if shortfall:
        warnings.warn(shortfall, processor.ProcessorWarning, stacklevel=2)
    with ExitStack() as stack:
        stack.enter_context(built.simulation.environment)
        recorder = company = share = None
        recording, terms = built.document.recording, replace(built.terms, timeout=timeout)
        omit: Sequence[str] = recording.omit
        messages = recording.messages
        if place is not None:
            # Imported for those who need it: the code for frames is slow to load.
            from symaware_cli.scenario import distribution

            company = distribution.company(built, place)
            stack.callback(company.port.close)
            share = distribution.part(place, company)
            if place.role == "member":
                # The host has the world and carries all messages.
                omit, messages = [*omit, "world", "applied"], "none"
        if log is not None:
            from symaware_cli.recording.recorder import Recorder
            from symaware_cli.recording.writer import LogWriter

            writer = stack.enter_context(LogWriter(log))
            notes = _attach(writer, built, share)
            recorder = Recorder(
                writer,
                built.simulation.environment,
                built.simulation.groups,
                interval=nanoseconds(recording.interval),
                omit=omit,
                quantities=built.quantities,
                events=recording.events,
                messages=messages,
                own=None if share is None else frozenset(share["agents"]),
            )
            for note in notes:
                recorder.event(Event("geometry-reduced", "environment", 0, Level.WARNING, note))
        return run(built.simulation, built.steps, recorder, on_progress, terms, company)


def _attach(writer: LogWriter, built: Built, part: Mapping[str, Any] | None) -> Sequence[str]:
    """Put into the log all that it takes to understand it, and to run it again; return what was left out."""
    from symaware_cli.recording.geometry import GeometryWriter
    from symaware_cli.recording.manifest import manifest

    document = built.document
    writer.attach(
        "manifest.json",
        "application/json",
        manifest(
            name=document.name,
            seed=document.seed,
            mode=document.run.mode,
            steps=built.steps,
            environment=built.simulation.environment,
            groups=built.simulation.groups,
            uses=built.uses,
            indexed={name: agents.count is not None for name, agents in document.agents.items()},
            part=part,
        ),
    )
    for name, content in built.files.items():
        media_type = _MEDIA_TYPES.get(PurePosixPath(name).suffix, "application/octet-stream")
        writer.attach(f"scenario/{name}", media_type, content)
    writer.attach(RESOLVED, "application/yaml", built.resolved)
    geometry = GeometryWriter(built.simulation.environment, built.files)
    for name, (media_type, content) in geometry.attachments.items():
        writer.attach(name, media_type, content)
    writer.attach("versions.json", "application/json", json.dumps(versions(), indent=1).encode())
    return geometry.notes
