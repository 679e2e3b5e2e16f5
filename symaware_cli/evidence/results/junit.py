"""JUnit XML: test suites and test cases, as most services of continuous integration show them.

There is no standard. Elements and attributes are those of the schema of Jenkins' xUnit plugin (``junit-10.xsd``), but
for `file` and `line` of a test case, which pytest and others add and GitLab shows.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence

from symaware_cli.evidence.results.result_case import CaseStatus, ResultCase, by_suite
from symaware_cli.evidence.results.result_format import ResultFormat

#: What XML 1.0 cannot contain, even as a character reference (section 2.2, production 2).
_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


class JUnit(ResultFormat):
    """Test suites in XML, for GitLab, Jenkins, GitHub's actions for test reports, and others."""

    def content(self, cases: Sequence[ResultCase], command: str) -> str:
        """Return the document."""
        root = ET.Element("testsuites", {"name": _text(f"symaware {command}"), **_counts(cases)})
        for suite, own in by_suite(cases).items():
            element = ET.SubElement(root, "testsuite", {"name": _text(suite), **_counts(own)})
            for case in own:
                _add(element, case)
        ET.indent(root)
        return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _counts(cases: Sequence[ResultCase]) -> dict[str, str]:
    statuses = [case.status for case in cases]
    return {
        "tests": str(len(cases)),
        "failures": str(statuses.count(CaseStatus.FAILURE)),
        "errors": str(statuses.count(CaseStatus.ERROR)),
        "skipped": str(statuses.count(CaseStatus.SKIPPED)),
        "time": f"{sum(case.time or 0.0 for case in cases):.3f}",
    }


def _add(suite: ET.Element, case: ResultCase) -> None:
    about = {"name": _text(case.name), "classname": _text(case.kind), "time": f"{case.time or 0.0:.3f}"}
    if case.span is not None:
        about |= {"file": _text(case.span.file), "line": str(case.span.line)}
    element = ET.SubElement(suite, "testcase", about)
    lines = _text("\n".join(filter(None, (case.message, case.details, case.place and f"at {case.place}"))))
    if case.status in (CaseStatus.FAILURE, CaseStatus.ERROR):
        found = ET.SubElement(element, case.status.value, {"type": _text(case.rule), "message": _text(case.message)})
        found.text = lines
    elif case.status is CaseStatus.SKIPPED:
        ET.SubElement(element, "skipped", {"message": _text(case.message)})
    elif lines and case.message:
        ET.SubElement(element, "system-out").text = lines


def _text(text: str) -> str:
    """Return a text with an escape in place of each character that XML cannot contain."""
    return _NO_XML.sub(lambda found: found[0].encode("unicode_escape", "surrogatepass").decode("ascii"), text)
