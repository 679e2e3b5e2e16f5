"""The index of a folder: one HTML page about all logs and sweeps in it, with pictures, verdicts and differences.

Reasons: docs/decisions/0106-index-of-a-folder.md
"""

from __future__ import annotations

import base64
import json
import os
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from symaware_cli.evidence.comparison import differing_values
from symaware_cli.language import RESOLVED, ScenarioError
from symaware_cli.log import Log, LogError, open_log, overview_of, read_yaml
from symaware_cli.log.digest import digest
from symaware_cli.studies import JOURNAL, SweepFolder, SweepJournal, is_sweep, plot_sweep
from symaware_cli.views import PlotRequest, matplotlib_required, plot
from symaware_cli.world import UserError

#: The most entries of a page; each has a picture of some 20 kB.
_MOST = 1_000

#: The most differences from the first log of a scenario that are listed.
_DIFFERENCES = 6

#: The most characters of a value that differs.
_VALUE = 60

#: Width and height of a picture [inch], and dots per inch.
_SIZE, _DPI = (4.4, 3.6), 72


@dataclass(frozen=True, slots=True)
class IndexEntry:
    """A log or a sweep of a folder.

    Attributes:
        path: Its path, relative to the folder.
        kind: ``log`` or ``sweep``.
        status: How the run ended, or the number of runs made of a sweep.
        name: The name of the scenario; empty if unknown.
        facts: Further facts about it, by name.
        verdicts: The verdict on each specification, and the counts, such as ``3 of 4``.
        differences: The differences from the first log of the same scenario.
        picture: Its picture as PNG; empty if there is nothing to draw.
        error: Why it cannot be read; empty if it can.
    """

    path: Path
    kind: str
    status: str = ""
    name: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    verdicts: Sequence[tuple[str, str, str]] = ()
    differences: Sequence[str] = ()
    picture: bytes = b""
    error: str = ""

    @property
    def picture_address(self) -> str:
        """The picture as the address of an image."""
        return f"data:image/png;base64,{base64.b64encode(self.picture).decode()}"


def index_entries(folder: Path, *, recursive: bool = False) -> list[IndexEntry]:
    """Return an entry for each log and each sweep in a folder, in the order of their paths.

    A folder that contains a sweep is one entry, regardless of its other content. Links to folders are not followed.

    Args:
        folder: The folder.
        recursive: Whether folders in it are searched for logs, too.

    Raises:
        LogError: The folder cannot be read, has neither logs nor sweeps or too many, or matplotlib is not installed.
    """
    with matplotlib_required():
        import matplotlib as _required  # noqa: F401  # so that it is missed once, not in each entry
    found = sorted(_found(folder, recursive=recursive))
    if not found:
        deeper = "" if recursive else " (--recursive searches the folders in it)"
        raise LogError(f"{folder} is not the folder of a sweep, and contains neither logs nor sweeps{deeper}")
    if len(found) > _MOST:
        raise LogError(f"{folder} contains {len(found):,} logs and sweeps; an index shows at most {_MOST:,}")
    firsts: dict[str, tuple[Path, Any]] = {}
    return [_entry(folder, path, firsts) for path in found]


def _found(folder: Path, *, recursive: bool) -> Iterator[Path]:
    try:
        with os.scandir(folder) as listing:
            children = sorted(listing, key=lambda each: each.name)
    except OSError as error:
        raise LogError(f"cannot read the folder {folder}: {error.strerror}") from error
    for child in children:
        path = Path(child.path)
        if child.is_dir(follow_symlinks=False):
            if is_sweep(path):
                yield path
            elif recursive and not child.name.startswith("."):
                yield from _found(path, recursive=True)
        elif child.name.endswith(".mcap"):
            yield path


def _entry(folder: Path, path: Path, firsts: dict[str, tuple[Path, Any]]) -> IndexEntry:
    relative = path.relative_to(folder)
    try:
        return _sweep(path, relative) if path.is_dir() else _log(path, relative, firsts)
    except (UserError, ScenarioError, OSError) as error:
        return IndexEntry(relative, "sweep" if path.is_dir() else "log", error=str(error))


def _log(path: Path, relative: Path, firsts: dict[str, tuple[Path, Any]]) -> IndexEntry:
    log = open_log(path)
    found = overview_of(log)
    facts = {"time": f"{found.simulated_time:g} s"} if found.simulated_time is not None else {}
    if found.foreign:
        facts["origin"] = "not written by SymAware"
        facts["messages"] = f"{sum(each.messages for each in found.channels):,}"
        return IndexEntry(relative, "log", found.status, facts=facts)
    facts["agents"] = ", ".join(f"{count} {name}" for name, count in found.agents.items())
    facts["seed"] = str(found.seed)
    if found.damage:
        facts["damage"] = found.damage
    facts["digest"] = digest(log).combined[:16]
    verdicts = _counted([(each.name, each.verdict) for each in found.specifications])
    name = found.name or ""
    return IndexEntry(
        relative,
        "log",
        found.status,
        name,
        facts,
        verdicts,
        _differences(log, relative, name, firsts),
        _drawn(lambda file: plot(log, file, PlotRequest(show=("trajectories",), size=_SIZE, dpi=_DPI))),
    )


def _sweep(path: Path, relative: Path) -> IndexEntry:
    opened = SweepFolder.opened(path)
    verdicts: list[tuple[str, str]] = []
    with SweepJournal(opened.path / JOURNAL) as journal:
        counts = journal.counts()
        for row in journal.rows("done"):
            verdicts += row.verdicts.items()
    document = opened.plan.document
    states = {name: f"{count:,}" for name, count in counts._asdict().items() if count and name != "all"}
    facts = {**states, "combinations": f"{len(opened.plan.cells):,}", "seed": str(document.seed)}
    if document.claim:
        facts["claim"] = str(document.claim)
    return IndexEntry(
        relative,
        "sweep",
        f"{counts.all:,} of {opened.plan.count:,} runs",
        opened.source.scenario.name,
        facts,
        _counted(verdicts),
        (),
        _drawn(lambda file: plot_sweep(path, file, size=_SIZE, dpi=_DPI)),
    )


def _counted(verdicts: Sequence[tuple[str, str]]) -> list[tuple[str, str, str]]:
    """Return name, verdict and count of each verdict; satisfied ones last, because others are looked for."""
    alike = Counter(verdicts)
    every = Counter(name for name, _ in verdicts)
    ordered = sorted(alike, key=lambda each: (each[1] == "satisfied", *each))
    return [(name, verdict, f"{alike[name, verdict]:,} of {every[name]:,}") for name, verdict in ordered]


def _drawn(draw: Any) -> bytes:
    """Return a picture as PNG; nothing if there is nothing to draw."""
    with tempfile.TemporaryDirectory() as temporary:
        file = Path(temporary, "picture.png")
        try:
            draw(file)
        except LogError:
            return b""
        return file.read_bytes()


def _differences(log: Log, relative: Path, name: str, firsts: dict[str, tuple[Path, Any]]) -> list[str]:
    """Return the values in which the scenario of a log differs from that of the first log with the same name."""
    try:
        data = read_yaml(log.attachments[RESOLVED])
    except (KeyError, ValueError):
        return []
    if name not in firsts:
        firsts[name] = (relative, data)
        return []
    first, other = firsts[name]
    changes = list(differing_values(other, data, ()))
    listed = [
        f"{'.'.join(map(str, path))}: {_shown(values[0])} → {_shown(values[1])}"
        for path, values in changes[:_DIFFERENCES]
    ]
    if len(changes) > _DIFFERENCES:
        listed.append(f"and {len(changes) - _DIFFERENCES} more values")
    return [f"compared with {first}: {'' if listed else 'the same scenario'}".rstrip(), *listed]


def _shown(value: Any) -> str:
    text = "nothing" if value is None else json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= _VALUE else f"{text[: _VALUE - 1]}…"
