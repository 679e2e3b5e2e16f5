"""The section about promises: the agents and results that rely on them, and when one was broken."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from symaware_cli.evidence.report.report_section import ReportSection, ReportSubject
from symaware_cli.views import Block, DataTable

#: The events of `promises.monitor`.
_EVENTS = ("promise-received", "promise-relied-on", "promise-broken")


class PromiseFacts(ReportSection):
    """The events about promises, such as which risks include the probability that one is broken."""

    title: ClassVar = "Promises"
    order: ClassVar = 65

    def applies(self, subject: ReportSubject) -> bool:
        """Return whether the subject is the log of a run."""
        return subject.log is not None and subject.run is not None

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield a row for each event."""
        assert subject.log is not None
        rows = [
            (f"{each.time / 1e9:g} s", each.source, each.text) for each in subject.log.events() if each.name in _EVENTS
        ]
        if rows:
            yield DataTable(("time", "who", "what"), rows)
