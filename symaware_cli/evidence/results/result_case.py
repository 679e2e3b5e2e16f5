"""A test case: one decision of a command, with its reason and its place."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

from symaware_cli.language import Problem, TextSpan


class CaseStatus(Enum):
    """How a test case ended.

    A negative decision is a failure, such as a violated specification; a decision that could not be made is an error,
    such as a failed run or a mistake in a scenario.
    """

    PASSED = "passed"
    WARNING = "warning"
    SKIPPED = "skipped"
    FAILURE = "failure"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class ResultCase:
    """A test case.

    Attributes:
        suite: The log, scenario or sweep that it belongs to.
        name: Its name, such as that of a specification; unique within its suite and kind.
        kind: The kind of its subject, such as ``specification``, ``claim``, ``row`` or ``channel``.
        status: How it ended.
        rule: A stable identifier of the fault, such as ``violated-specification`` or the code of a problem; empty
            without a fault.
        message: The reason, in one sentence.
        details: More lines for people, such as a traceback.
        span: Its place in a file, if it has one.
        time: The wall time that it took [s], if that is known.
    """

    suite: str
    name: str
    kind: str
    status: CaseStatus = CaseStatus.PASSED
    rule: str = ""
    message: str = ""
    details: str = ""
    span: TextSpan | None = None
    time: float | None = None

    @property
    def place(self) -> str:
        """Its place as ``file:line``; empty if it has none."""
        return f"{self.span.file}:{self.span.line}" if self.span else ""


def problem_cases(suite: str, problems: Iterable[Problem], status: CaseStatus = CaseStatus.ERROR) -> list[ResultCase]:
    """Return the problems or the warnings of files as test cases, whose rules are the codes of the problems."""
    cases = []
    for each in problems:
        where = each.path or (f"{each.span.file}:{each.span.line}:{each.span.column}" if each.span else suite)
        hints = [f"expected {each.expected}"] if each.expected else []
        hints += [f"did you mean `{each.suggestion}`?"] if each.suggestion else []
        lines = [*([each.source_line] if each.source_line and len(each.source_line) <= 1000 else []), *hints]
        cases.append(
            ResultCase(suite, where, "problem", status, each.code, each.message, "\n".join(lines), span=each.span)
        )
    return cases


def by_suite(cases: Sequence[ResultCase]) -> dict[str, list[ResultCase]]:
    """Return the test cases of each suite, in their order."""
    found: dict[str, list[ResultCase]] = {}
    for case in cases:
        found.setdefault(case.suite, []).append(case)
    return found
