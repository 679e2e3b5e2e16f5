"""The explanation of a violation from the file beside the log, as ``symaware explain LOG --json`` wrote it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import ClassVar

from symaware_cli.evidence.causes.explanation_file import (
    ExplainedCandidate,
    ExplanationFile,
    LoggedComparison,
    beside,
    read_explanation,
)
from symaware_cli.evidence.report.report_section import ReportSection, ReportSubject
from symaware_cli.views import Block, CodeLines, DataTable, FactTable, Inline, Paragraph

#: The most candidates that are shown.
_MOST_ROWS = 50


class ExplanationSection(ReportSection):
    """The causes of a violation, if ``NAME.explain.json`` is beside the log ``NAME.mcap``."""

    title: ClassVar = "Why it was violated"
    order: ClassVar = 65

    def applies(self, subject: ReportSubject) -> bool:
        """Return whether the subject is a log with an explanation beside it."""
        return subject.log is not None and subject.run is not None and beside(subject.path).is_file()

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield the causes, the comparisons, and the commands that repeat them; or why the file cannot be used."""
        assert subject.log is not None
        path = beside(subject.path)
        found = read_explanation(path, subject.log)
        if isinstance(found, str):
            yield Paragraph((Inline(path.name, "code"), f" {found}"), "error")
            return
        yield Paragraph((Inline(found.text, "prose"),))
        yield FactTable(dict(_facts(found)))
        if found.candidates:
            heads = ("candidate", *(f"from {at:g} s" for at in found.plan.instants), "in general", "at least")
            yield DataTable(heads, [_cells(each, found.plan.instants) for each in found.candidates[:_MOST_ROWS]])
            if len(found.candidates) > _MOST_ROWS:
                yield Paragraph((f"and {len(found.candidates) - _MOST_ROWS:,} more",), "note")
            explained = (
                "saved: made right from then on, it prevents the violation of this run. In general: the share of "
                "redrawn futures that this saves minus that of the placebo; with confidence "
                f"{found.confidence:g}, its lower bound is above 0 only for causes."
            )
            yield Paragraph((explained,), "note")
        commands = [each.command for each in found.candidates if each.cause]
        commands += [found.together.command] if found.together else []
        if commands:
            yield CodeLines("\n".join(commands))


def _facts(found: ExplanationFile) -> Iterator[tuple[str, str]]:
    best = max(found.everything, key=lambda each: each.strength)
    yield "all at once", _shares(best)
    causes = [each for each in found.candidates if each.cause]
    if not found.among_candidates:
        yield "cause", f"none in {found.where}"
    elif not causes:
        yield "cause", f"in {found.where}, but no single one"
    for number, each in enumerate(causes, 1):
        best = max(each.in_general, key=lambda test: test.strength)
        yield f"cause {number}" if len(causes) > 1 else "cause", f"{each.candidate.text}: {_shares(best)}"
    if found.together is not None:
        names = ", and ".join(each.text for each in found.together.candidates)
        yield "together", f"{names}: {_shares(found.together.in_general)}"
    uncompared = sum(each.screening == "left" and not each.compared for each in found.candidates)
    if uncompared:
        yield "not compared", f"{uncompared} that screening left"
    yield "branches", f"{found.branches:,}"


def _shares(test: LoggedComparison) -> str:
    saved = f"{test.saved_by_truth} of {test.futures} futures saved"
    saved += (
        ", too few for a difference" if test.saved_by_placebo is None else f", with the placebo {test.saved_by_placebo}"
    )
    return f"{saved}, from {test.at:g} s on"


def _cells(row: ExplainedCandidate, instants: Sequence[float]) -> tuple[str, ...]:
    saved = {each.at: "saved" if each.saved else "-" for each in row.in_this_run}
    run = [saved.get(at, "") for at in instants]
    best = max(row.in_general, key=lambda test: test.strength, default=None)
    if best is None or best.difference is None:
        is_left = row.screening == "left" and not row.compared
        return (row.candidate.text, *run, "not compared" if is_left else "-", "-")
    lower = math.nan if best.lower is None else best.lower
    return (row.candidate.text, *run, f"{best.difference:+.0%}", f"{lower:+.0%}")
