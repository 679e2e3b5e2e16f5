"""The journal of a sweep: one row a run in SQLite, written by the driver alone and committed by blocks.

What was committed survives the death of the process at any instant.
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

#: Errors of SQLite that are about the disk or its rights, not about the content of the file.
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
    """How many runs are in which state."""

    done: int
    failed: int
    lost: int

    @property
    def all(self) -> int:
        """How many rows there are."""
        return self.done + self.failed + self.lost


class JournalRecord(NamedTuple):
    """What the table has of a run, as the journal has it: parameters, verdicts, robustness and metrics are JSON."""

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
    """The journal of a sweep; used in a ``with`` statement, which turns errors of SQLite into those below.

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
        """Write what became of a run, of which nothing is written yet; it is committed soon."""
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
        """Return what to raise for an error of SQLite."""
        code = getattr(error, "sqlite_errorcode", None)  # an error of the module itself has none
        if code is not None and code & 0xFF in _OF_OUTPUT:
            return OutputError(f"cannot write {self._path}: {error}")
        return SweepError(f"{self._path} is damaged: {error}")

    def commit(self) -> None:
        """Make sure that all rows survive."""
        if self._database.in_transaction:
            self._database.execute("COMMIT")

    def indices(self) -> set[int]:
        """The numbers of all runs that are written."""
        return {index for (index,) in self._database.execute('SELECT "index" FROM runs')}

    def counts(self) -> Counts:
        """How many runs are in which state."""
        found = dict(self._database.execute("SELECT state, count(*) FROM runs GROUP BY state").fetchall())
        return Counts(*(found.get(state, 0) for state in Counts._fields))

    def rows(self, state: str | None = None) -> Iterator[Row]:
        """Yield all rows in order of their index, or those in a state."""
        where, values = ("WHERE state = ?", (state,)) if state else ("", ())
        # Closed even where nobody takes all of them: an open cursor keeps the file from shrinking.
        with closing(self._database.execute(f'SELECT {_FIELDS} FROM runs {where} ORDER BY "index"', values)) as cursor:
            for values in cursor:
                yield _row(values)

    def records(self) -> Iterator[JournalRecord]:
        """Yield what the table has of all runs, in order of their index."""
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
        """Take all rows in a state away, so that these runs are made again; returns how many."""
        return self._database.execute("DELETE FROM runs WHERE state = ?", (state,)).rowcount

    def drop(self, indices: Iterable[int]) -> None:
        """Take rows away that do not belong to the result, if they are there."""
        self.commit()
        self._database.execute("BEGIN")
        self._database.executemany('DELETE FROM runs WHERE "index" = ?', ((index,) for index in indices))
        self.commit()

    def keep_logs(self, logs: Iterable[tuple[int, str | None]]) -> None:
        """Note the log of runs, or that there is none any more."""
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
