"""Exports a log as a folder of tables, in one pass and in bounded memory.

Reasons: docs/decisions/0011-exports.md
"""

from __future__ import annotations

from abc import abstractmethod
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar

from symaware_cli.log import Log, LogError
from symaware_cli.views.exporting import run_tables
from symaware_cli.views.exporting.export_format import Exported, ExportFormat, Progress
from symaware_cli.views.exporting.log_selection import Selection
from symaware_cli.views.exporting.sources import TableSource, sources_of
from symaware_cli.views.exporting.table import Sheet, Table, Values, images_beside, length

_HELD = 8 << 20
"""Amount of log data held in memory before the longest table is written [bytes]."""

_OVERHEAD = 512
"""Memory overhead of a decoded message [bytes]."""

_PROGRESS = 256
"""Number of messages between two progress reports."""


@dataclass(frozen=True, slots=True)
class Written:
    """A table that was written.

    Attributes:
        file: Its path in the folder.
        rows: Number of rows.
        size: Its size in bytes, including the images beside it.
        columns: Names of its columns.
    """

    file: str
    rows: int
    size: int
    columns: tuple[str, ...]


class TableFormat(ExportFormat):
    """A format with a file for each table of a log.

    Attributes:
        table_suffix: The suffix of the files, such as ``.csv``.
        explains: Whether the files contain units and facts about the log themselves; otherwise these are two more
            tables.
    """

    table_suffix: ClassVar[str]
    explains: ClassVar[bool] = False

    @abstractmethod
    def sheet(self, path: Path, table: Table, about: Mapping[str, str]) -> Sheet:
        """Create the file of a table, which is written batch by batch.

        Args:
            path: The path of the file.
            table: The table.
            about: Facts about the log.

        Raises:
            OSError: The file cannot be created.
        """

    def write(self, log: Log, place: Path, selection: Selection, on_progress: Progress) -> Exported:
        """Write the tables of a log."""
        written = _written(log, place, self, selection, on_progress)
        parts = [(each.file, each.rows, each.size) for each in written]
        facts = {"tables": [asdict(each) for each in written]}
        return Exported(parts, ("table", "rows"), sum(each.size for each in written), facts)


def _written(log: Log, place: Path, form: TableFormat, selection: Selection, on_progress: Progress) -> list[Written]:
    """Write the tables of a log into a folder, and return them by name."""
    with _TableFolder(place, form, run_tables.about(log)) as book:
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
    log: Log, sources: Mapping[str, TableSource], selection: Selection, on_progress: Progress
) -> Iterator[tuple[Table, list[Values]]]:
    """Read a log in one pass; convert the messages of a topic when much data have accumulated."""
    entries: dict[str, list[tuple[int, Any]]] = {topic: [] for topic in sources}
    sizes: defaultdict[str, int] = defaultdict(int)
    now = -1
    for number, message in enumerate(log.messages(sources, selection.start, selection.end)):
        if on_progress and number % _PROGRESS == 0:
            on_progress(message.time)
        # Only between two instants, since all messages of an instant are converted together.
        while message.time > now and sum(sizes.values()) >= _HELD:
            longest = max(sizes, key=sizes.__getitem__)
            yield _convert(log, longest, sources[longest], entries[longest])
            entries[longest] = []
            del sizes[longest]
        now = message.time
        entries[message.channel.topic].append((now, message.decode()))
        sizes[message.channel.topic] += sources[message.channel.topic].growth * (len(message.data) + _OVERHEAD)
    for topic, source in sources.items():
        if entries[topic] or not source.table.optional:
            yield _convert(log, topic, source, entries.pop(topic))


def _convert(
    log: Log, topic: str, source: TableSource, entries: Sequence[tuple[int, Any]]
) -> tuple[Table, list[Values]]:
    try:
        return source.table, source.convert(entries)
    except (ValueError, IndexError, AttributeError, OverflowError) as error:
        raise LogError(f"the messages on {topic} in {log.path} do not fit together: {error}") from error


class _TableFolder:
    """The files of a folder. A file is created with its first rows; that of an optional table only if there are any."""

    def __init__(self, folder: Path, form: TableFormat, about: Mapping[str, str]) -> None:
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
        """Complete the files, and describe them."""
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
        # After an error, which is propagating and more informative than an error of closing.
        for sheet in self._open.values():
            with suppress(OSError):
                sheet.close()

    def _path(self, table: Table) -> Path:
        return self._folder / (table.path + self._form.table_suffix)


def _size(path: Path) -> int:
    return sum(each.stat().st_size for each in (path, *images_beside(path).glob("*.png")))
