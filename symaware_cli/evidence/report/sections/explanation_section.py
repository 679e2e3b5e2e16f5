"""The explanation of a violation that stands beside the log, as ``symaware explain LOG --json`` wrote it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import BaseModel, Field, ValidationError

from symaware_cli.evidence.report.report_section import ReportSection, ReportSubject
from symaware_cli.log import Log, reason
from symaware_cli.log.digest import digest
from symaware_cli.views import Block, CodeLines, DataTable, FactTable, Inline, Paragraph

#: The end of the name of an explanation, after the name of the log without its own.
SUFFIX = ".explain.json"

#: The greatest explanation that is read [bytes], and the most candidates that are shown.
_MOST_BYTES, _MOST_ROWS = 10_000_000, 50

#: A text of the file, and a finite number.
_Text = Annotated[str, Field(max_length=10_000)]
_Number = Annotated[float, Field(allow_inf_nan=False)]


class _Named(BaseModel):
    text: _Text


class _Comparison(BaseModel):
    at: _Number
    futures: int
    saved_by_truth: int
    saved_by_placebo: int | None
    difference: _Number | None
    lower: _Number | None
    established: bool

    @property
    def strength(self) -> tuple[bool, float, float]:
        """The order of comparisons: established ones, then by the difference, then the earliest."""
        return self.established, -1.0 if self.difference is None else self.difference, -self.at


class _Saved(BaseModel):
    at: _Number
    saved: bool


class _Row(BaseModel):
    candidate: _Named
    cause: bool
    compared: bool
    screening: _Text
    in_this_run: list[_Saved]
    in_general: list[_Comparison]
    command: _Text


class _Together(BaseModel):
    candidates: list[_Named]
    in_general: _Comparison
    command: _Text


class _Plan(BaseModel):
    instants: list[_Number]


class _Explanation(BaseModel):
    """What is read of an explanation."""

    digest: _Text
    specification: _Text
    violated: _Number
    text: _Text
    where: _Text
    branches: int
    confidence: _Number
    plan: _Plan
    among_candidates: bool
    everything: list[_Comparison] = Field(min_length=1)
    together: _Together | None
    candidates: list[_Row]


class ExplanationSection(ReportSection):
    """What would have prevented a violation, if ``NAME.explain.json`` is beside the log ``NAME.mcap``."""

    title: ClassVar = "Why it was violated"
    order: ClassVar = 65

    def applies(self, subject: ReportSubject) -> bool:
        """Return whether the subject is a log with an explanation beside it."""
        return subject.log is not None and subject.run is not None and _beside(subject.path).is_file()

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield the causes, what was tried, and the commands that repeat it; or why the file is of no use."""
        assert subject.log is not None
        path = _beside(subject.path)
        found = _read(path, subject.log)
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


def _beside(log: Path) -> Path:
    return log.with_name(log.stem + SUFFIX)


def _read(path: Path, log: Log) -> _Explanation | str:
    """Read an explanation; return why it cannot be shown, if it cannot."""
    try:
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
    except OSError as error:
        return f"cannot be read: {reason(error)}"
    if len(data) > _MOST_BYTES:
        return f"has more than {_MOST_BYTES / 1e6:g} MB, which no explanation has"
    try:
        found = _Explanation.model_validate_json(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        return f"is not what `symaware explain --json` writes: {where + ': ' if where else ''}{first['msg']}"
    if found.digest != digest(log).combined:
        return "explains another log, and is not shown"
    return found


def _facts(found: _Explanation) -> Iterator[tuple[str, str]]:
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


def _shares(test: _Comparison) -> str:
    saved = f"{test.saved_by_truth} of {test.futures} futures saved"
    saved += (
        ", too few for a difference" if test.saved_by_placebo is None else f", with the placebo {test.saved_by_placebo}"
    )
    return f"{saved}, from {test.at:g} s on"


def _cells(row: _Row, instants: Sequence[float]) -> tuple[str, ...]:
    saved = {each.at: "saved" if each.saved else "-" for each in row.in_this_run}
    run = [saved.get(at, "") for at in instants]
    best = max(row.in_general, key=lambda test: test.strength, default=None)
    if best is None or best.difference is None:
        is_left = row.screening == "left" and not row.compared
        return (row.candidate.text, *run, "not compared" if is_left else "-", "-")
    lower = math.nan if best.lower is None else best.lower
    return (row.candidate.text, *run, f"{best.difference:+.0%}", f"{lower:+.0%}")
