"""Sections about a sweep: plan, shares with intervals, certificate, figures of metrics, least robust run."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from symaware_cli.evidence.certificate_check import CERTIFICATE
from symaware_cli.evidence.certificate_page import content
from symaware_cli.evidence.report.report_section import ReportSection, ReportSubject
from symaware_cli.evidence.signed_statement import read_statement
from symaware_cli.log import LogError
from symaware_cli.studies import JOURNAL, SweepJournal, read_shares
from symaware_cli.views import Block, CertificateBlock, DataTable, FactTable, Inline, Paragraph, Picture

#: The maximum number of shares listed.
_MOST = 200


class _SweepSection(ReportSection):
    """A section about a sweep."""

    def applies(self, subject: ReportSubject) -> bool:
        """Return whether the subject is a sweep."""
        return subject.folder is not None


class SweepFacts(_SweepSection):
    """Scenario, plan, runs so far and claim of a sweep."""

    order: ClassVar = 10

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield the table."""
        folder = subject.folder
        assert folder is not None
        document = folder.plan.document
        with SweepJournal(folder.path / JOURNAL) as journal:
            counts = journal.counts()
        states = ", ".join(f"{count:,} {name}" for name, count in counts._asdict().items() if count)
        yield FactTable(
            {
                "scenario": f"{folder.source.scenario.name}, seed of the sweep {document.seed}",
                "asked": document.description,
                "runs": f"{counts.all:,} of {folder.plan.count:,}: {states}",
                "combinations": f"{len(folder.plan.cells):,}",
                "claim": document.claim or "none",
            }
        )


class SweepShares(_SweepSection):
    """The share of the runs that satisfy each specification, with its interval."""

    title: ClassVar = "Statistics"
    order: ClassVar = 20

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield a row for each combination and specification."""
        found = read_shares(subject.path)
        rows = []
        for each in found[:_MOST]:
            parameters = (f"{path} = {value}" for path, value in each.cell.parameters.items())
            names = [*filter(None, [each.cell.variant]), *parameters]
            interval = each.interval
            known = f"{interval.lower:.4g} to {interval.upper:.4g} ({interval.method}, {interval.confidence:g})"
            rows.append(
                (
                    ", ".join(names) or "as it is",
                    each.specification,
                    f"{each.satisfied:,} of {interval.count:,}",
                    f"{interval.value:.4g}",
                    known if interval.method else "none: the runs depend on each other",
                )
            )
        if rows:
            yield DataTable(("combination", "specification", "satisfied", "share", "interval"), rows)


class CertificateSection(_SweepSection):
    """The certificate in the folder of a sweep."""

    order: ClassVar = 30

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield the certificate as found in the folder."""
        file = subject.path / CERTIFICATE
        if not file.is_file():
            return
        try:
            read = read_statement(file.read_bytes())
            yield CertificateBlock(content(read.content, read.public_key))
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            yield Paragraph((f"{CERTIFICATE} cannot be read: {error}",), "error")
            return
        yield Paragraph(("As found in the folder; this page does not verify it.",), "note")


class SweepFigures(_SweepSection):
    """The figures of the metrics of a sweep."""

    title: ClassVar = "Figures"
    order: ClassVar = 40

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield the picture, or the reason why there is none."""
        from symaware_cli.studies import plot_sweep

        with tempfile.TemporaryDirectory() as temporary:
            picture = Path(temporary, "plot.svg")
            try:
                plot_sweep(subject.path, picture)
            except LogError as error:
                yield Paragraph((Inline(str(error), "prose"),), "note")
            else:
                yield Picture(picture.read_bytes(), "svg+xml", "Metrics of the runs")


class LeastRobustRun(_SweepSection):
    """The run of a sweep that is shown, and the command to repeat it."""

    order: ClassVar = 50

    def applies(self, subject: ReportSubject) -> bool:
        """Return whether the subject is a sweep with a finished run."""
        return subject.row is not None

    def heading(self, subject: ReportSubject) -> str:
        """Return a heading with the number of the run."""
        assert subject.row is not None
        return f"Run {subject.row.index}, the least robust"

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield the verdicts of the run, and the command to repeat it."""
        row = subject.row
        assert row is not None
        said = ", ".join(f"{name} {verdict}" for name, verdict in row.verdicts.items())
        command = f"symaware run {subject.path.name} --index {row.index}"
        yield Paragraph((f"{said}. ", Inline(command, "code")))
