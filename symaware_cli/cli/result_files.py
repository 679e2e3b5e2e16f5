"""The option ``--results``: files with the results of a command, for continuous integration.

Verbs note their results, and errors are noted when they are shown (`terminal`). The files are written when the command
ends, also with an error.

Reasons: docs/decisions/0085-results-for-continuous-integration.md
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from contextvars import ContextVar, Token
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from symaware_cli.evidence import ResultCase, ResultFile
    from symaware_cli.language import Problem


class _Results:
    """The results of a command, which are written at its end; a context manager."""

    def __init__(self, files: Sequence[ResultFile], command: str) -> None:
        self.command = command
        self.cases: list[ResultCase] = []
        self._files = files
        self._token: Token[_Results | None] | None = None

    def __enter__(self) -> None:
        self._token = _CURRENT.set(self)

    def __exit__(self, *_: object) -> None:
        # Click closes its resources without the exception.
        ending = sys.exc_info()[1]
        if ending is not None and not isinstance(ending, typer.Exit | typer.Abort | SystemExit):
            from symaware_cli.world import describe

            note_error("interrupted" if isinstance(ending, KeyboardInterrupt) else "failed-command", describe(ending))
        if self._token is not None:
            _CURRENT.reset(self._token)
        for file in self._files:
            file.write(self.cases, self.command)


_CURRENT: ContextVar[_Results | None] = ContextVar("results", default=None)


def _opened(ctx: typer.Context, given: list[str] | None) -> list[str]:
    if given and not ctx.resilient_parsing:
        from symaware_cli.evidence import ResultFile

        ctx.with_resource(_Results([ResultFile.named(text) for text in given], ctx.info_name or ""))
    return given or []  # None is no list for older versions of Typer


def results_option(panel: str | None = None) -> Any:
    """The option that names files for results, in a panel of the help."""
    said = "Write the results for continuous integration, also if the command fails, as junit, sarif, or in the format "
    said += "of a plugin; may be repeated."
    return typer.Option("--results", callback=_opened, help=said, metavar="FORMAT:FILE", rich_help_panel=panel)


Results = Annotated[list[str] | None, results_option()]


def note(cases: Callable[[], Iterable[ResultCase]]) -> None:
    """Note test cases, if results are to be written; otherwise they are not asked for."""
    current = _CURRENT.get()
    if current is not None:
        current.cases += cases()


def note_problems(problems: Iterable[Problem], *, is_warning: bool = False) -> None:
    """Note the problems of files as errors, or as warnings, if results are to be written."""
    current = _CURRENT.get()
    if current is not None:
        from symaware_cli.evidence import CaseStatus, problem_cases

        status = CaseStatus.WARNING if is_warning else CaseStatus.ERROR
        for each in problems:
            current.cases += problem_cases(each.span.file if each.span else current.command, [each], status)


def note_error(rule: str, message: str) -> None:
    """Note an error that ends the command, if results are to be written."""
    current = _CURRENT.get()
    if current is not None:
        from symaware_cli.evidence import CaseStatus, ResultCase

        command = current.command
        current.cases.append(ResultCase(f"symaware {command}", command, "command", CaseStatus.ERROR, rule, message))


def note_passed(suite: str, name: str, kind: str, message: str) -> None:
    """Note one test case that passed, if results are to be written."""
    current = _CURRENT.get()
    if current is not None:
        from symaware_cli.evidence import ResultCase

        current.cases.append(ResultCase(suite, name, kind, message=message))
