"""SARIF 2.1.0: faults with rules and places, which code hosts show beside the lines of files.

Source: Static Analysis Results Interchange Format (SARIF) Version 2.1.0, OASIS Standard, 27 March 2020.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from symaware_cli.evidence.results.result_case import CaseStatus, ResultCase
from symaware_cli.evidence.results.result_format import ResultFormat
from symaware_cli.language import TextSpan
from symaware_cli.version import __version__

_SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/os/schemas/sarif-schema-2.1.0.json"
_LEVELS = {CaseStatus.WARNING: "warning", CaseStatus.FAILURE: "error", CaseStatus.ERROR: "error"}
#: The name of the folder that relative URIs are relative to (section 3.14.14).
_BASE = "SRCROOT"


class Sarif(ResultFormat):
    """Faults with their rules and places in files, for code hosts and editors."""

    def content(self, cases: Sequence[ResultCase], command: str) -> str:
        """Return the document: a result for each failure, error and warning."""
        shown = [case for case in cases if case.status in _LEVELS]
        rules = list(dict.fromkeys(case.rule for case in shown))
        driver = {"name": "symaware", "version": __version__, "rules": [{"id": rule} for rule in rules]}
        run: dict[str, Any] = {
            "tool": {"driver": driver},
            "automationDetails": {"id": f"symaware/{command}/"},
            # Columns of places are counted in characters, not in bytes or in units of UTF-16.
            "columnKind": "unicodeCodePoints",
            "results": [_result(case, rules.index(case.rule)) for case in shown],
        }
        return json.dumps({"$schema": _SCHEMA, "version": "2.1.0", "runs": [run]}, indent=2) + "\n"


def _result(case: ResultCase, rule: int) -> dict[str, Any]:
    lines = [case.message or case.rule, *case.details.splitlines()]
    about = "" if case.kind == "problem" else f"{case.suite}, {case.kind} {case.name}: "
    found: dict[str, Any] = {
        "ruleId": case.rule,
        "ruleIndex": rule,
        "level": _LEVELS[case.status],
        "message": {"text": about + "\n".join(lines)},
    }
    location: dict[str, Any] = {"logicalLocations": [{"fullyQualifiedName": f"{case.kind}/{case.name}"}]}
    artifact = None if case.span is None else _artifact(case.span.file)
    if case.span is not None and artifact is not None:
        location["physicalLocation"] = {"artifactLocation": artifact, "region": _region(case.span)}
    return {**found, "locations": [location]}


def _artifact(file: str) -> dict[str, str] | None:
    """The location of a file, relative to the current folder if it is below; None if it is no file."""
    if file.startswith("--") or not Path(file).is_file():
        return None
    path = Path(file).resolve()
    if path.is_relative_to(Path.cwd()):
        return {"uri": quote(path.relative_to(Path.cwd()).as_posix()), "uriBaseId": _BASE}
    return {"uri": path.as_uri()}


def _region(span: TextSpan) -> dict[str, int]:
    return {
        "startLine": span.line,
        "startColumn": span.column,
        "endLine": span.line,
        "endColumn": max(span.end_column, span.column),
    }
