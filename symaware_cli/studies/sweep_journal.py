"""The journal of a sweep: one row per run in SQLite, written only by the driver and committed in blocks.

Committed rows survive the death of the process at any time.
"""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

from symaware_cli.log import OutputError
from symaware_cli.studies.row import Row
from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.sweep_plan import SweepPlan

#: Wall time between two commits [s].
_INTERVAL = 0.5

#: Errors of SQLite caused by the disk or permissions, not by the content of the file.
_OF_OUTPUT = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_CANTOPEN)

_SCHEMA = """
CREATE TABLE IF NOT EXISTS runs (
    "index" INTEGER PRIMARY KEY,
    identity TEXT NOT NULL,
    parameters TEXT NOT NULL,
    variant TEXT,
    seed_key INTEGER NOT NULL,
    seed INTEGER NOT NULL,
    state TEXT NOT NULL,
    verdicts TEXT NOT NULL,
    robustness TEXT NOT NULL,
    metrics TEXT NOT NULL,
    digest TEXT,
    error TEXT,
    trace TEXT,
    log TEXT,
    wall_time REAL NOT NULL
) WITHOUT ROWID
"""

_FIELDS = '"index", state, verdicts, robustness, metrics, digest, error, trace, wall_time, log'


class Counts(NamedTuple):
    """The number of runs in each state."""

    done: int
    failed: int
    lost: int

    @property
    def all(self) -> int:
        """The total number of runs."""
        return self.done + self.failed + self.lost


class JournalRecord(NamedTuple):
    """The columns of the journal that the table contains; parameters, verdicts, robustness and metrics are JSON."""

    index: Any
    variant: Any
    parameters: Any
    seed: Any
    state: Any
    verdicts: Any
    robustness: Any
    metrics: Any
    digest: Any
    error: Any


class SweepJournal:
    """The journal of a sweep; use it in a ``with`` statement, which converts errors of SQLite.

    Raises:
        SweepError: The file is damaged.
        OutputError: It cannot be opened or written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._due = 0.0
        try:
            self._database = sqlite3.connect(path, isolation_level=None)
            self._database.execute("PRAGMA journal_mode = WAL")
            self._database.execute("PRAGMA synchronous = NORMAL")
            self._database.execute(_SCHEMA)
        except sqlite3.Error as error:
            if hasattr(self, "_database"):
                self._database.close()
            raise self._named(error) from error

    def __enter__(self) -> SweepJournal:
        return self

    def __exit__(self, _: object, error: BaseException | None, trace: object) -> None:
        try:
            self.close()
        except sqlite3.Error as late:
            if error is None:
                raise self._named(late) from late
        if isinstance(error, sqlite3.Error):
            raise self._named(error) from error

    def close(self) -> None:
        """Commit, and close the file."""
        self.commit()
        self._database.close()

    def add(self, row: Row, plan: SweepPlan, identity: str) -> None:
        """Write the row of a run that has none yet; it is committed with the next block."""
        if not self._database.in_transaction:
            self._database.execute("BEGIN")
            self._due = time.monotonic() + _INTERVAL
        values = (
            *(row.index, identity, _text(plan.parameters(row.index)), plan.cell(row.index).variant),
            *(plan.seed_key(row.index), plan.seed(row.index), row.state),
            *(_text(row.verdicts), _text(row.robustness), _text(row.metrics)),
            *(row.digest, row.error, row.trace, row.log, row.wall_time),
        )
        self._database.execute(f"INSERT INTO runs VALUES ({','.join('?' * len(values))})", values)
        if time.monotonic() >= self._due:
            self.commit()

    def _named(self, error: sqlite3.Error) -> SweepError | OutputError:
        """Return the exception to raise for an error of SQLite."""
        code = getattr(error, "sqlite_errorcode", None)  # an error of the module itself has none
        if code is not None and code & 0xFF in _OF_OUTPUT:
            return OutputError(f"cannot write {self._path}: {error}")
        return SweepError(f"{self._path} is damaged: {error}")

    def commit(self) -> None:
        """Commit all rows."""
        if self._database.in_transaction:
            self._database.execute("COMMIT")

    def indices(self) -> set[int]:
        """Return the numbers of all runs with a row."""
        return {index for (index,) in self._database.execute('SELECT "index" FROM runs')}

    def counts(self) -> Counts:
        """Return the number of runs in each state."""
        found = dict(self._database.execute("SELECT state, count(*) FROM runs GROUP BY state").fetchall())
        return Counts(*(found.get(state, 0) for state in Counts._fields))

    def rows(self, state: str | None = None) -> Iterator[Row]:
        """Yield all rows, or those in one state, in order of their index."""
        where, values = ("WHERE state = ?", (state,)) if state else ("", ())
        # Closed even if the caller does not read all rows: an open cursor keeps the file from shrinking.
        with closing(self._database.execute(f'SELECT {_FIELDS} FROM runs {where} ORDER BY "index"', values)) as cursor:
            for values in cursor:
                yield _row(values)

    def records(self) -> Iterator[JournalRecord]:
        """Yield the records of the table for all runs, in order of their index."""
        names = ", ".join(f'"{name}"' for name in JournalRecord._fields)
        yield from map(JournalRecord._make, self._database.execute(f'SELECT {names} FROM runs ORDER BY "index"'))

    def identities(self) -> Iterator[tuple[int, str]]:
        """Yield the index and the identity of all runs, in order of their index."""
        yield from self._database.execute('SELECT "index", identity FROM runs ORDER BY "index"')

    def times(self) -> Iterator[tuple[int, float]]:
        """Yield the index and the wall time of all runs, in order of their index [s]."""
        yield from self._database.execute('SELECT "index", wall_time FROM runs ORDER BY "index"')

    def row(self, index: int) -> Row | None:
        """Return the row of a run, if there is one."""
        found = self._database.execute(f'SELECT {_FIELDS} FROM runs WHERE "index" = ?', (index,)).fetchone()
        return _row(found) if found else None

    def forget(self, state: str) -> int:
        """Delete all rows in a state, so that these runs are repeated; returns their number."""
        return self._database.execute("DELETE FROM runs WHERE state = ?", (state,)).rowcount

    def drop(self, indices: Iterable[int]) -> None:
        """Delete any rows of runs that do not belong to the result."""
        self.commit()
        self._database.execute("BEGIN")
        self._database.executemany('DELETE FROM runs WHERE "index" = ?', ((index,) for index in indices))
        self.commit()

    def keep_logs(self, logs: Iterable[tuple[int, str | None]]) -> None:
        """Store the names of the logs of runs; None if a log no longer exists."""
        self.commit()
        self._database.execute("BEGIN")
        self._database.executemany('UPDATE runs SET log = ? WHERE "index" = ?', [(log, index) for index, log in logs])
        self.commit()


def _text(content: Any) -> str:
    return json.dumps(content, ensure_ascii=False)


def _row(values: tuple[Any, ...]) -> Row:
    index, state, *texts = values[:5]
    try:
        contents = [json.loads(text) for text in texts]
    except (TypeError, ValueError):
        contents = [None]
    if not all(isinstance(content, dict) for content in contents):
        raise SweepError(f"the journal is damaged: the row of run {index} is none")
    return Row(index, state, *contents, *values[5:])
