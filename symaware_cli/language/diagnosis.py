"""The problems of a scenario while it is built, each at its place in the files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NoReturn

from symaware_cli.language.compose import Composition
from symaware_cli.language.problem import Problem, ScenarioError, dotted, is_inside, nearest, quoted
from symaware_cli.language.source import Path
from symaware_cli.world import listed

if TYPE_CHECKING:
    from symaware_cli.specification import ExpressionError

_REFERENCES = {"bad-reference", "cyclic-parameter", "undefined-parameter"}


class ReportedError(Exception):
    """A part of the scenario cannot be built; the problem is already reported."""


class Diagnosis:
    """Collects the problems of a scenario, so that one pass reports all of them.

    Attributes:
        composition: The composed document, from which problems get their positions.
        earlier: Problems with single values that were found while the document was composed.
        problems: The problems found since.
        warnings: Warnings about valid but probably unintended values.
    """

    def __init__(self, composition: Composition, earlier: Sequence[Problem] = ()) -> None:
        self.composition = composition
        self.earlier = tuple(earlier)
        self.problems: list[Problem] = []
        self.warnings: list[Problem] = []
        #: Where the sections are written that add entries which no file contains, by the paths of these entries.
        self._places: dict[Path, Path] = {}
        #: Where entries are written that sections add as they have them, by the paths of these entries.
        self._moved: dict[Path, Path] = {}

    def place_at(self, above: Path, names: Iterable[str], section: Path) -> None:
        """Locate problems with entries that a section of the scenario adds at this section.

        Args:
            above: The path of the entries without their names.
            names: The names of the entries.
            section: The path of the section that adds them.
        """
        self._places |= {(*above, name): section for name in names}

    def move(self, entry: Path, to: Path) -> None:
        """Locate problems below an entry that a section of the scenario adds at the place where it is written.

        Args:
            entry: The path of the entry.
            to: The path at which it is written: with the same keys, or as a single text.
        """
        self._moved[entry] = to

    def _placed(self, path: Path) -> Path:
        """Return where an entry is written."""
        if path[:2] in self._moved:
            return (*self._moved[path[:2]], *path[2:])
        if not self._places:
            return path
        return next((self._places[path[:end]] for end in (2, 3) if path[:end] in self._places), path)

    def report(
        self,
        code: str,
        message: str,
        path: Path,
        *,
        key: bool = False,
        expected: str | None = None,
        suggestion: str | None = None,
    ) -> None:
        """Note a problem; the arguments are those of `Composition.problem`."""
        self.problems.append(
            self.composition.problem(
                code, message, self._placed(path), key=key, expected=expected, suggestion=suggestion
            )
        )

    def warn(self, code: str, message: str, path: Path, *, key: bool = False, expected: str | None = None) -> None:
        """Note a warning; the arguments are those of `Composition.problem`."""
        self.warnings.append(self.composition.problem(code, message, self._placed(path), key=key, expected=expected))

    def refuse(self, code: str, message: str, path: Path, **hints: Any) -> NoReturn:
        """Note a problem that ends the building of the present part.

        Raises:
            ReportedError: Always.
        """
        self.report(code, message, path, **hints)
        raise ReportedError

    def report_unknown(self, kind: str, name: str, path: Path, known: Iterable[str]) -> None:
        """Note that nothing of a kind has a name or matches a pattern, with the names that exist."""
        names = list(dict.fromkeys(known))
        expected = f"one of {listed(names)}" if names else None
        message = f"there is no {kind} {quoted(name)}"
        self.report("unknown-target", message, path, expected=expected, suggestion=nearest(name, names))

    def report_expression(self, text: str, path: Path, error: ExpressionError, expected: str | None = None) -> None:
        """Note a problem with an expression, at its position in the file.

        Args:
            text: The expression.
            path: The path of the expression.
            error: The error.
            expected: A description of a valid expression, used if the error lists no valid names.
        """
        from symaware_cli.specification import RESERVED

        path = self._placed(path)
        problem = self.composition.problem(
            "bad-expression",
            f"{quoted(dotted(path))}: {error.problem}",
            path,
            expected=f"one of {', '.join(error.names)}" if error.names else expected,
            suggestion=nearest(error.name, {*error.names, *RESERVED}) if error.name else None,
        )
        self.problems.append(_with_position(problem, text, error))

    def raise_problems(self) -> NoReturn:
        """End the building.

        Raises:
            ScenarioError: Contains all problems, except those that merely follow from the earlier ones.
        """
        raise ScenarioError([*self.earlier, *filter(self._is_independent, self.problems)])

    def _is_independent(self, problem: Problem) -> bool:
        """Whether a problem is more than a consequence of a value that is invalid, which is already reported."""
        if any(problem.span == known.span for known in self.earlier):
            return False
        return not any(is_inside(problem.path, path) for path in self._invalid_paths)

    @cached_property
    def _invalid_paths(self) -> set[str]:
        """The paths of invalid values, and of texts with references that could not be resolved."""
        paths = {known.path for known in self.earlier}
        if any(known.code in _REFERENCES for known in self.earlier):
            leaves = leaves_of(self.composition.data)
            paths |= {dotted(path) for path, value in leaves if isinstance(value, str) and "${" in value}
        return paths


def _with_position(problem: Problem, text: str, error: ExpressionError) -> Problem:
    """Narrow the span of a problem to the wrong part of an expression, if the file contains its text unchanged."""
    span, line = problem.span, problem.source_line
    if span is None or line is None:
        return problem
    written = line[span.column - 1 : span.end_column - 1]
    shift = 1 if written[:1] in ("'", '"') and written[1:-1] == text else 0
    if not shift and written != text:
        return problem
    start = span.column + shift
    return replace(problem, span=replace(span, column=start + error.start, end_column=start + error.end))


def leaves_of(value: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """Yield the single values in a document, or in a part of it at ``path``, each with its path."""
    if not isinstance(value, Mapping | list):
        yield path, value
        return
    for key, each in value.items() if isinstance(value, Mapping) else enumerate(value):
        yield from leaves_of(each, (*path, key))
