"""Files with results: JUnit's XML and SARIF contain the decisions on test cases with any texts."""

import json
from pathlib import Path

import junitparser
import pytest

from symaware_cli.entry_points import PluginError
from symaware_cli.evidence.results.junit import JUnit
from symaware_cli.evidence.results.result_case import CaseStatus, ResultCase, problem_cases
from symaware_cli.evidence.results.result_format import ResultFile
from symaware_cli.evidence.results.sarif import Sarif
from symaware_cli.language import Problem, TextSpan
from symaware_cli.world import UserError

SPAN = TextSpan("scenario.yaml", 3, 5, 9)
CASES = [
    ResultCase("log", "safe", "specification"),
    ResultCase(
        "log", "near", "specification", CaseStatus.FAILURE, "violated-specification", "a < b", "more", SPAN, 1.5
    ),
    ResultCase("log", "late", "specification", CaseStatus.SKIPPED, message="undecided"),
    ResultCase("other", "run", "run", CaseStatus.ERROR, "failed-run", "it ended", "Traceback"),
    ResultCase("other", "odd", "problem", CaseStatus.WARNING, "odd-value", "is it meant?", span=SPAN),
]


def junit(cases: list[ResultCase]) -> junitparser.JUnitXml:
    return junitparser.JUnitXml.fromstring(JUnit().content(cases, "check").encode())


def test_junit_counts_failures_and_errors_apart_in_each_suite() -> None:
    root = junit(CASES)
    assert (root.tests, root.failures, root.errors, root.skipped) == (5, 1, 1, 1)
    first, second = root
    assert (first.name, first.tests, first.failures, first.errors, first.skipped) == ("log", 3, 1, 0, 1)
    assert (second.name, second.tests, second.failures, second.errors) == ("other", 2, 0, 1)


def test_a_test_case_has_its_reason_and_its_place() -> None:
    near = list(next(iter(junit(CASES))))[1]
    (failure,) = near.result
    assert isinstance(failure, junitparser.Failure)
    assert (failure.type, failure.message) == ("violated-specification", "a < b")
    assert failure.text == "a < b\nmore\nat scenario.yaml:3"
    assert (near.classname, near.name, near.time) == ("specification", "near", 1.5)
    assert (near._elem.get("file"), near._elem.get("line")) == ("scenario.yaml", "3")


@pytest.mark.parametrize("text", ["\x00\x1b[31m", "]]>&<\"'", "\ud800", "\ufffe\uffff", "é\U0001f600", "\x85\u2028"])
def test_any_text_can_be_part_of_the_files(text: str) -> None:
    case = ResultCase(text, text, text, CaseStatus.FAILURE, text, text, text, TextSpan(text, 1, 1, 1))
    (suite,) = junit([case])
    (read,) = suite
    shown = text.translate({0: "\\x00", 0x1B: "\\x1b", 0xD800: "\\ud800", 0xFFFE: "\\ufffe", 0xFFFF: "\\uffff"})
    assert read.name == shown
    (failure,) = read.result
    assert failure.message == shown
    if text.isprintable():
        assert failure.text.splitlines()[0] == text
    file = json.loads(Sarif().content([case], "check"))
    assert file["runs"][0]["results"][0]["ruleId"] == text


def sarif_faults(document: object) -> list[str]:
    """Requirements of the standard that a document lacks: properties, their values, and indices of rules."""
    assert isinstance(document, dict)
    faults = [] if document.get("version") == "2.1.0" else ["version"]
    for run in document["runs"]:
        rules = [rule["id"] for rule in run["tool"]["driver"]["rules"]]
        faults += [] if run["tool"]["driver"]["name"] else ["name"]
        faults += [] if len(set(rules)) == len(rules) else ["rules are unique"]
        for result in run["results"]:
            faults += [] if rules[result["ruleIndex"]] == result["ruleId"] else ["ruleIndex"]
            faults += [] if result["level"] in ("none", "note", "warning", "error") else ["level"]
            faults += [] if isinstance(result["message"]["text"], str) and result["message"]["text"] else ["message"]
            for location in result["locations"]:
                if physical := location.get("physicalLocation"):
                    region, uri = physical["region"], physical["artifactLocation"]["uri"]
                    faults += [] if not uri.startswith("/") and " " not in uri and "\\" not in uri else [uri]
                    faults += [] if min(region.values()) >= 1 else ["region"]
                    faults += [] if region["endColumn"] >= region["startColumn"] else ["columns"]
    return faults


def test_sarif_has_results_only_for_faults_with_rules_levels_and_regions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenario.yaml").touch()
    document = json.loads(Sarif().content(CASES, "check"))
    assert sarif_faults(document) == []
    (run,) = document["runs"]
    assert [(each["ruleId"], each["level"]) for each in run["results"]] == [
        ("violated-specification", "error"),
        ("failed-run", "error"),
        ("odd-value", "warning"),
    ]
    assert run["results"][0]["locations"][0]["physicalLocation"] == {
        "artifactLocation": {"uri": "scenario.yaml", "uriBaseId": "SRCROOT"},
        "region": {"startLine": 3, "startColumn": 5, "endLine": 3, "endColumn": 9},
    }
    assert "physicalLocation" not in run["results"][1]["locations"][0]


@pytest.mark.parametrize(("name", "uri"), [("a b/c#d.yaml", "a%20b/c%23d.yaml"), ("--set x=1", None), ("gone", None)])
def test_a_uri_is_relative_and_escaped_and_only_for_files_that_are_there(
    name: str, uri: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if uri:
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).touch()
    cases = problem_cases("s", [Problem("unknown-key", "m", TextSpan(name, 1, 1, 2))])
    document = json.loads(Sarif().content(cases, "validate"))
    assert sarif_faults(document) == []
    found = document["runs"][0]["results"][0]["locations"][0].get("physicalLocation")
    assert (found and found["artifactLocation"]["uri"]) == uri


@pytest.mark.parametrize("text", ["junit", "junit:", ":file", "file.xml"])
def test_a_file_of_results_is_named_with_its_format(text: str) -> None:
    with pytest.raises(UserError, match="takes FORMAT:FILE"):
        ResultFile.named(text)


def test_an_unknown_format_and_a_missing_folder_are_refused_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(PluginError, match="`junti`") as caught:
        ResultFile.named("junti:x.xml")
    assert caught.value.suggestion == "junit"
    with pytest.raises(UserError, match="there is no folder"):
        ResultFile.named(f"junit:{tmp_path}/none/x.xml")
