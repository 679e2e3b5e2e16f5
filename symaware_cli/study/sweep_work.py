"""The runs of a sweep as work, from its folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from symaware_cli.study.folder import SweepFolder
from symaware_cli.study.row import Row
from symaware_cli.study.runner import Runner
from symaware_cli.study.work import Block


class SweepWork:
    """`Work` that makes the rows of a sweep."""

    def __init__(self, folder: str, batch: int | None) -> None:
        """Prepare; the folder need not be there before `open`.

        Args:
            folder: The folder of the sweep.
            batch: See `Runner`.
        """
        self._path = folder
        self._batch = batch
        self._opened: tuple[Path, Runner] | None = None

    def open(self) -> None:
        """See `Work`."""
        self._made()

    def prepare(self) -> None:
        """See `Work`."""
        self._made()[1].prepare()

    def results(self, block: Block) -> Iterator[Row]:
        """See `Work`."""
        logs, runner = self._made()
        yield from runner.rows(block.indices, logs if block.is_recorded else None)

    def to_json(self) -> dict[str, Any]:
        """See `Work`."""
        return {"kind": "sweep", "folder": self._path, "batch": self._batch}

    def received(self, content: dict[str, Any]) -> Row:
        """See `Work`."""
        return Row(**content)

    def lost(self, index: int, why: str) -> Row:
        """See `Work`."""
        return Row(index, "lost", error=why)

    def _made(self) -> tuple[Path, Runner]:
        """Where logs are written, and what makes runs."""
        if self._opened is None:
            folder = SweepFolder.opened(self._path)
            self._opened = folder.logs, folder.runner(self._batch)
        return self._opened
