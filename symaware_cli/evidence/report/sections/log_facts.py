"""Sections about a log: outcome, scenario, agents and digest; the channels of a log by another program."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from symaware_cli.evidence.report.report_section import ReportSection, ReportSubject
from symaware_cli.log.digest import digest
from symaware_cli.views import Block, DataTable, FactTable


class LogFacts(ReportSection):
    """Outcome, scenario, agents, simulated time and digest of a log."""

    order: ClassVar = 10

    def applies(self, subject: ReportSubject) -> bool:
        """Return whether the subject is a log."""
        return subject.log is not None

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield the table."""
        found = subject.overview
        assert found is not None
        assert subject.log is not None
        if found.foreign:
            # Such a log does not record how it was produced or how to repeat it.
            yield FactTable(
                {
                    "origin": "not written by SymAware; only its channels can be shown",
                    "time": found.span,
                    "messages": f"{sum(each.messages for each in found.channels):,}",
                    "damage": found.damage,
                }
            )
            return
        yield FactTable(
            {
                "outcome": found.status + (f"; {found.damage}" if found.damage else ""),
                "scenario": f"{found.name}, seed {found.seed}, {found.mode}",
                "agents": ", ".join(f"{count} {name}" for name, count in found.agents.items()),
                "other bodies": ", ".join(found.entities),
                "simulated time": f"{found.simulated_time or 0:g} s, {found.steps} steps of {found.time_step} s",
                "digest": digest(subject.log).combined,
            }
        )


class Channels(ReportSection):
    """The channels of a log by another program."""

    title: ClassVar = "Channels"
    order: ClassVar = 20

    def applies(self, subject: ReportSubject) -> bool:
        """Return whether the subject is a log by another program."""
        return subject.overview is not None and subject.overview.foreign

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield a row for each channel."""
        assert subject.overview is not None
        rows = [
            (each.topic, f"{each.messages:,}", f"{each.rate:.4g} Hz" if each.rate else "", each.schema)
            for each in subject.overview.channels
        ]
        yield DataTable(("channel", "messages", "rate", "content"), rows)


class EventCounts(ReportSection):
    """How often each event occurred."""

    title: ClassVar = "Events"
    order: ClassVar = 95

    def applies(self, subject: ReportSubject) -> bool:
        """Return whether the subject is the log of a run."""
        return subject.log is not None and subject.run is not None

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield the counts."""
        assert subject.overview is not None
        if subject.overview.events:
            yield FactTable({name: f"{count:,}" for name, count in subject.overview.events.items()})
