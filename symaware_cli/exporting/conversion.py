"""From a log to a folder of tables, in one pass and in bounded memory."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from symaware_cli.exporting import run_tables
from symaware_cli.exporting.log_selection import Selection
from symaware_cli.exporting.sources import TableSource, sources_of
from symaware_cli.exporting.table import Form, Sheet, Table, Values, images_beside, length
from symaware_cli.recording.error import LogError
from symaware_cli.recording.output import whole_folder
from symaware_cli.recording.reader import Log

_HELD = 8 << 20
"""How much of a log is held before the longest table is written on [bytes]."""

_OVERHEAD = 512
"""What a message takes beside its data when it is decoded [bytes]."""

_PROGRESS = 256
"""Messages between two reports of progress."""


@dataclass(frozen=True, slots=True)
class Written:
    """A file that was written.

    Attributes:
        file: Its path in the folder.
        rows: How many rows it has.
        size: Its size in bytes, with that of the images beside it.
        columns: What its columns are called.
    """

    file: str
    rows: int
    size: int
    columns: tuple[str, ...]


def export_tables(
    log: Log,
    folder: str | os.PathLike[str],
    form: Form,
    selection: Selection | None = None,
    on_progress: Callable[[int], None] | None = None,
) -> list[Written]:
    """Write the tables of a log.

    Args:
        log: The log. What is damaged in it is left out; `Log.damage` tells of it afterwards.
        folder: Where; must not exist or be empty, and appears when everything in it is complete.
        form: What the files are to be.
        selection: What of the log is wanted; None for everything.
        on_progress: Is told now and then which simulated time was reached [ns].

    Returns:
        The files, by name.

    Raises:
        LogError: The log is not one of ours or has no manifest, what the form needs is not installed, or the folder
            cannot be written; nothing is left behind then.
    """
    log.require_manifest()
    selection = selection or Selection()
    with whole_folder(folder) as place, _TableFolder(place, form, run_tables.about(log)) as book:
        try:
            book.write(run_tables.AGENTS, run_tables.agent_rows(log, selection))
            book.write(run_tables.ENTITIES, run_tables.entity_rows(log, selection))
            sources = sources_of(log, selection)
        except (KeyError, TypeError, AttributeError) as error:
            raise LogError(f"the manifest in {log.path} is damaged") from error
        for table, values in _batches(log, sources, selection, on_progress):
            book.write(table, values)
        return book.finish()


def _batches(
    log: Log, sources: Mapping[str, TableSource], selection: Selection, on_progress: Callable[[int], None] | None
) -> Iterator[tuple[Table, list[Values]]]:
    """Read a log in one pass, and lay out what was read where it has become much."""
    entries: dict[str, list[tuple[int, Any]]] = {topic: [] for topic in sources}
    sizes: defaultdict[str, int] = defaultdict(int)
    now = -1
    for number, message in enumerate(log.messages(sources, selection.start, selection.end)):
        if on_progress and number % _PROGRESS == 0:
            on_progress(message.time)
        # Between two instants, since what is said of one instant belongs together.
        while message.time > now and sum(sizes.values()) >= _HELD:
            longest = max(sizes, key=sizes.__getitem__)
            yield _laid_out(log, longest, sources[longest], entries[longest])
            entries[longest] = []
            del sizes[longest]
        now = message.time
        entries[message.channel.topic].append((now, message.decode()))
        sizes[message.channel.topic] += sources[message.channel.topic].growth * (len(message.data) + _OVERHEAD)
    for topic, source in sources.items():
        if entries[topic] or not source.table.optional:
            yield _laid_out(log, topic, source, entries.pop(topic))


def _laid_out(
    log: Log, topic: str, source: TableSource, entries: Sequence[tuple[int, Any]]
) -> tuple[Table, list[Values]]:
    try:
        return source.table, source.convert(entries)
    except (ValueError, IndexError, AttributeError, OverflowError) as error:
        raise LogError(f"the messages on {topic} in {log.path} do not fit together: {error}") from error


class _TableFolder:
    """The files of a folder. One is created with its first rows, and an optional one only if it has any."""

    def __init__(self, folder: Path, form: Form, about: Mapping[str, str]) -> None:
        self._folder = folder
        self._form = form
        self._about = about
        self._open: dict[Table, Sheet] = {}
        self._rows: dict[Table, int] = {}

    def write(self, table: Table, values: Sequence[Values]) -> None:
        """Append rows to a table."""
        count = length(values[0])
        if table not in self._open:
            if table.optional and not count:
                return
            path = self._path(table)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._open[table] = self._form.sheet(path, table, self._about)
            self._rows[table] = 0
        self._open[table].write(values)
        self._rows[table] += count

    def finish(self) -> list[Written]:
        """Complete the files, and say what they are."""
        if not self._form.explains:
            self.write(run_tables.RUN, run_tables.run_rows(self._about))
            self.write(run_tables.COLUMNS, run_tables.column_rows([*self._open, run_tables.COLUMNS]))
        while self._open:
            self._open.popitem()[1].close()
        written = [
            Written(
                self._path(table).relative_to(self._folder).as_posix(),
                count,
                _size(self._path(table)),
                tuple(column.name for column in table.columns),
            )
            for table, count in self._rows.items()
        ]
        return sorted(written, key=lambda each: each.file)

    def __enter__(self) -> _TableFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        # After an error, which is on its way and tells more than that of closing would.
        for sheet in self._open.values():
            with suppress(OSError):
                sheet.close()

    def _path(self, table: Table) -> Path:
        return self._folder / (table.path + self._form.suffix)


def _size(path: Path) -> int:
    return sum(each.stat().st_size for each in (path, *images_beside(path).glob("*.png")))
