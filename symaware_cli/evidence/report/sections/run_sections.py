"""Sections about the run that is shown: verdicts of its specifications, replay, animated map, and figures."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from symaware_cli.evidence.report.report_section import ReportSection, ReportSubject
from symaware_cli.log import LogError
from symaware_cli.specification import Outcome
from symaware_cli.views import (
    Block,
    DataTable,
    Inline,
    MotionMap,
    Paragraph,
    Picture,
    ReplayFrame,
    matplotlib_required,
    plot,
)
from symaware_cli.views.embedded_viewer import embedded_viewer
from symaware_cli.views.replay_session import replay_session
from symaware_cli.views.viewer import require


class Verdicts(ReportSection):
    """The verdict on each specification, with its robustness and the reason."""

    title: ClassVar = "Specifications"
    order: ClassVar = 60

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield a row for each specification and its agents."""
        assert subject.run is not None
        rows = [_row(each) for each in subject.run.outcomes]
        if rows:
            yield DataTable(("name", "formula", "verdict", "robustness", "reason"), rows)


class ReplayFrameSection(ReportSection):
    """The Rerun viewer with a replay of the run."""

    title: ClassVar = "Replay"
    order: ClassVar = 70
    on_paper: ClassVar = False

    def applies(self, subject: ReportSubject) -> bool:
        """Return whether the viewer was requested and there is a run."""
        return subject.has_viewer and subject.run is not None

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield the viewer."""
        assert subject.run is not None
        require()
        with tempfile.TemporaryDirectory() as temporary:
            recording = Path(temporary, "run.rrd")
            replay_session(subject.run).save(recording)
            yield ReplayFrame(embedded_viewer(recording))


class MotionMapSection(ReportSection):
    """The motion of the run as an animated map."""

    title: ClassVar = "The run"
    order: ClassVar = 80
    on_paper: ClassVar = False

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield the map, if the log has motion."""
        with matplotlib_required():
            from symaware_cli.views.moving_map import moving_map
        assert subject.run is not None
        try:
            yield MotionMap(moving_map(subject.run))
        except LogError as error:
            yield Paragraph((Inline(str(error), "prose"),), "note")


class RunFigureSection(ReportSection):
    """The default plot of the run."""

    title: ClassVar = "Figures"
    order: ClassVar = 90

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield the picture, or the reason why there is none."""
        with matplotlib_required():
            pass
        assert subject.run is not None
        with tempfile.TemporaryDirectory() as temporary:
            picture = Path(temporary, "plot.svg")
            try:
                plot(subject.run, picture)
            except LogError as error:
                yield Paragraph((Inline(str(error), "prose"),), "note")
            else:
                yield Picture(picture.read_bytes(), "svg+xml", "Trajectories and quantities over time")


def _row(outcome: Outcome) -> tuple[str | Inline, ...]:
    robustness = outcome.robustness
    who = f" ({' and '.join(outcome.agents)})" if outcome.agents else ""
    return (
        outcome.name,
        Inline(outcome.formula, "code"),
        Inline(outcome.verdict, "verdict"),
        "" if robustness is None else f"{'' if outcome.is_exact else 'at most '}{robustness:.6g}",
        Inline(outcome.reason + who, "prose"),
    )
