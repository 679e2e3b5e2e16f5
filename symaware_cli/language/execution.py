"""Executes a built scenario: creates the run and its log, with everything needed to repeat it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from symaware_cli import processor
from symaware_cli.core import Event, Level, nanoseconds
from symaware_cli.engine import Role, Run, RunSummary
from symaware_cli.language.build import Built
from symaware_cli.language.files import RESOLVED
from symaware_cli.language.versions import versions

if TYPE_CHECKING:
    from symaware_cli.log import LogWriter, MessageWatch, Recorder

_MEDIA_TYPES = {".toml": "application/toml", ".yaml": "application/yaml", ".yml": "application/yaml"}


def execute(
    built: Built,
    log: Path | None,
    on_progress: Callable[[int], None] | None = None,
    timeout: float | None = None,
    role: Role | None = None,
) -> RunSummary:
    """Run a scenario, or the part of one process; see `prepared`.

    Raises:
        LogError: The log cannot be written.

    Warns:
        ProcessorWarning: The last bits of the results may differ on other processors.
    """
    processor.warn_once(stacklevel=2)
    with prepared(built, log, on_progress, timeout, role) as run:
        return run.execute()


def write_log(built: Built, log: Path) -> None:
    """Run a scenario for its log, within a process that continues afterwards.

    Raises:
        RunError: The run failed; its log is finished.
        KeyboardInterrupt: A signal ended the run; its log is finished.
        LogError: The log cannot be written.
    """
    with prepared(built, log, may_exit=False) as run:
        run.advance()
    if run.failure is not None:
        raise run.failure
    if run.signal is not None:
        raise KeyboardInterrupt


@contextmanager
def prepared(
    built: Built,
    log: Path | None,
    on_progress: Callable[[int], None] | None = None,
    timeout: float | None = None,
    role: Role | None = None,
    may_exit: bool = True,
    on_message: MessageWatch | None = None,
) -> Iterator[Run]:
    """Create the run of a scenario, or of the part of one process, with its environment and log open.

    Args:
        built: The built scenario; it cannot be run twice.
        log: The path of the log, or None for no log.
        on_progress: Called at intervals of wall time with simulated time in nanoseconds.
        timeout: Wall time after which the run is interrupted [s].
        role: The role of this process in a run of several processes; None in a run of one process.
        may_exit: Whether the process may be ended if the run does not react to a second signal or its time-out.
        on_message: See `LogWriter`.

    Raises:
        LogError: The log cannot be written.
        DistributionError: This process cannot have that role.
        TransportError: The other processes cannot be reached.
    """
    options = replace(built.options, timeout=timeout, may_exit=may_exit)
    with ExitStack() as stack:
        stack.enter_context(built.simulation.environment)
        participant, share = (None, None) if role is None else role.take_part(stack, built, log)
        recorder = None if log is None else _recorder(stack, built, log, role, share, on_message)
        yield Run(built.simulation, built.steps, recorder, on_progress, options, participant)


@np.errstate(all="ignore")  # as while it runs
def _recorder(
    stack: ExitStack,
    built: Built,
    log: Path,
    role: Role | None,
    share: Mapping[str, Any] | None,
    on_message: MessageWatch | None,
) -> Recorder:
    from symaware_cli.log import LogWriter, Recorder

    recording = built.document.recording
    omit: Sequence[str] = recording.omit
    messages = recording.messages
    if role is not None and not role.records_world:
        # The host records the world and all messages.
        omit, messages = [*omit, "world", "applied_control"], "none"
    # What a process of several captures is restored in another process only.
    writer = stack.enter_context(LogWriter(log, on_message=on_message, goes_back=role is None))
    notes = _attach(writer, built, share)
    recorder = Recorder(
        writer,
        built.simulation.environment,
        built.simulation.groups,
        interval=nanoseconds(recording.interval),
        omit=omit,
        events=recording.events,
        messages=messages,
        own=None if share is None else frozenset(share["agents"]),
    )
    for note in notes:
        recorder.event(Event("geometry-reduced", "environment", 0, Level.WARNING, note))
    return recorder


def _attach(writer: LogWriter, built: Built, part: Mapping[str, Any] | None) -> Sequence[str]:
    """Attach everything needed to read the log and to repeat the run; return notes on omitted geometry."""
    from symaware_cli.log import manifest_of

    document, environment = built.document, built.simulation.environment
    writer.attach(
        "manifest.json",
        "application/json",
        manifest_of(
            name=document.name,
            seed=document.seed,
            mode=document.run.mode,
            steps=built.steps,
            environment=environment,
            groups=built.simulation.groups,
            uses=built.uses,
            indexed={name: agents.count is not None for name, agents in document.agents.items()},
            part=part,
            tolerances=built.simulation.tolerances,
        ),
    )
    for name, content in built.files.items():
        media_type = _MEDIA_TYPES.get(PurePosixPath(name).suffix, "application/octet-stream")
        writer.attach(f"scenario/{name}", media_type, content)
    writer.attach(RESOLVED, "application/yaml", built.resolved)
    for entry in built.simulation.entries:
        for component in entry.components:
            folder = f"faults.{entry.section[1]}/{component.path}" if entry.is_substitute else component.path
            for name, content in component.attachments().items():
                writer.attach(f"{folder}/{name}", "application/octet-stream", content)
    for group in built.simulation.groups:
        for name, content in group.model.attachments().items():
            writer.attach(f"agents.{group.name}.model/{name}", "application/octet-stream", content)
    notes: Sequence[str] = ()
    # Without either, the manifest describes the appearance of all bodies.
    if environment.ground is not None or environment.articulations():
        from symaware_cli.log import GeometryWriter

        geometry = GeometryWriter(environment, built.files)
        notes = geometry.notes
        for name, (media_type, content) in geometry.attachments.items():
            writer.attach(name, media_type, content)
    writer.attach("versions.json", "application/json", json.dumps(versions(), indent=1).encode())
    return notes
