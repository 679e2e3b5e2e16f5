"""Sections of reports, each about one aspect of a log or a sweep."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from symaware_cli.log import Log, Overview, overview_of
from symaware_cli.studies import Row, SweepFolder
from symaware_cli.views import Block
from symaware_cli.world import PluginKind


@dataclass(frozen=True)
class ReportSubject:
    """The subject of a report: a log or a sweep.

    Attributes:
        path: The log, or the folder of a sweep.
        log: The log; None for a sweep.
        folder: The sweep; None for a log.
        run: The log of the run that is shown: the log itself, or a repetition of the least robust run of a sweep. None
            for a log by another program, and for a sweep without a finished run.
        row: The row of that run in the table of the sweep.
        has_viewer: Whether the viewer with a replay of the run was requested.
    """

    path: Path
    log: Log | None = None
    folder: SweepFolder | None = None
    run: Log | None = None
    row: Row | None = None
    has_viewer: bool = False

    @cached_property
    def overview(self) -> Overview | None:
        """The overview of the log; None for a sweep."""
        return None if self.log is None else overview_of(self.log)


class ReportSection(ABC):
    """A section of a report.

    Attributes:
        title: Its heading; empty for none.
        order: The sort key of the section. Sections of this package have orders below 100 if they are about the result,
            and from 1,000 on if they are about the scenario and its repetition.
        on_paper: Whether it is printed, too.
    """

    title: ClassVar[str] = ""
    order: ClassVar[float] = 500
    on_paper: ClassVar[bool] = True

    def applies(self, subject: ReportSubject) -> bool:
        """Return whether the report of a subject has this section; by default, whether it shows a run."""
        return subject.run is not None

    def heading(self, subject: ReportSubject) -> str:
        """Return the heading; by default the title."""
        return self.title

    @abstractmethod
    def content(self, subject: ReportSubject) -> Iterable[Block]:
        """Yield the content from top to bottom; a section without content is left out."""


class _SectionKind(PluginKind):
    """The plugin kind of sections, which declare their titles and order."""

    def fault(self, loaded: Any) -> str | None:
        """Return why an object is not a section, or declares something invalid."""
        fault = super().fault(loaded)
        if fault is not None:
            return fault
        if not isinstance(loaded.title, str):
            return "has a title that is not a text"
        if not isinstance(loaded.order, int | float) or not math.isfinite(loaded.order):
            return "has an order that is not a number"
        return None


SECTION = _SectionKind("report", "symaware.reports", (ReportSection,))
