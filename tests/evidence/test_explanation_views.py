"""An explanation with given numbers, as a picture, a section of a report, marks of a replay, and text."""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plot_logs import YARD, log_of

from symaware_cli import Log
from symaware_cli.evidence.causes.candidate import DeclaredFault, LinkMessages, PairBelief
from symaware_cli.evidence.causes.explanation import (
    CandidateRow,
    CandidateSet,
    Explanation,
    ExplanationPlan,
    FutureComparison,
)
from symaware_cli.evidence.causes.explanation_file import beside
from symaware_cli.evidence.causes.explanation_marks import Causes
from symaware_cli.evidence.causes.paired_shares import PairedShares
from symaware_cli.evidence.causes.timeline import draw_timeline
from symaware_cli.evidence.report.report_section import ReportSubject
from symaware_cli.evidence.report.sections.explanation_section import ExplanationSection
from symaware_cli.log import LogError
from symaware_cli.log.digest import digest
from symaware_cli.views import CodeLines, DataTable, FactTable, Paragraph
from symaware_cli.views.detail import detail_of
from symaware_cli.views.scene.marks import Journal, Lines, Rings
from symaware_cli.views.scene.scene import Scene
from symaware_cli.views.views import run_view_of

BELIEF = PairBelief("cart.0", "cart.1", "state", is_drawn=True)
FAULT = DeclaredFault("gust", "pushes cart.1", 0.1, 0.3)
LINK = LinkMessages("cart.0", "guard", 3, 0)
SAVING = FutureComparison(0.1, PairedShares(16, 12, 0, 4), 0.5, 0.9)
USELESS = FutureComparison(0.1, PairedShares(16, 2, 1, 0), -0.3, 0.4)
WITHOUT_PLACEBO = FutureComparison(0.1, PairedShares(16, 1, 0, 0), float("nan"), float("nan"), has_placebo=False)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    return log_of(tmp_path_factory.mktemp("yard"), YARD, "run.duration=0.5")


@pytest.fixture
def explanation(log: Log) -> Explanation:
    """A cause, a candidate that is none, one whose placebo was not tried, and one that was not compared."""
    errors = [np.nan, 0.1, 0.2, 0.3, 0.4, 0.5]
    rows = [
        CandidateRow(BELIEF, [True, False], [SAVING], True, errors, "symaware branch belief"),
        CandidateRow(FAULT, [False, False], [USELESS], True, [], "symaware branch fault"),
        CandidateRow(replace(FAULT, name="mist"), [False, False], [WITHOUT_PLACEBO], True, [], "symaware branch mist"),
        CandidateRow(LINK, [True, True], [], True, [], "symaware branch link"),
        CandidateRow(replace(BELIEF, about="guard"), [False, False], [], False, errors, "symaware branch other"),
    ]
    return Explanation(
        log=log.path,
        digest=digest(log).combined,
        specification="apart",
        violated=0.4,
        text="cart.0 and cart.1 are too close",
        kinds=["beliefs", "messages", "faults"],
        plan=ExplanationPlan(100, 1.0, 16, 5, [0.1, 0.2]),
        branches=96,
        confidence=0.95,
        everything=[SAVING],
        rows=rows,
        together=None,
        over=[],
        times=[0.0, 0.1, 0.2, 0.3, 0.4, 0.5],
    )


@pytest.fixture
def put(log: Log) -> Iterator[Callable[[Explanation], object]]:
    """Write an explanation beside the log, for one test."""
    yield lambda found: beside(log.path).write_text(json.dumps(found.to_json()))
    beside(log.path).unlink(missing_ok=True)


Put = Callable[[Explanation], object]


def sections(log: Log) -> list[object]:
    subject = ReportSubject(log.path, log=log, run=log)
    assert ExplanationSection().applies(subject)
    return list(ExplanationSection().content(subject))


def test_the_report_has_the_cause_its_shares_and_the_command_that_repeats_it(
    log: Log, explanation: Explanation, put: Put
) -> None:
    assert not ExplanationSection().applies(ReportSubject(log.path, log=log, run=log))
    put(explanation)
    text, facts, table, _, commands = sections(log)
    assert "too close" in str(text)
    assert isinstance(facts, FactTable)
    assert facts.facts["cause"] == f"{BELIEF.text}: 16 of 16 futures saved, with the placebo 4, from 0.1 s on"
    assert (facts.facts["not compared"], facts.facts["branches"]) == ("1 that screening left", "96")
    assert isinstance(table, DataTable)
    assert [row[1:] for row in table.rows] == [
        ("saved", "-", "+75%", "+50%"),
        ("-", "-", "+6%", "-30%"),
        ("-", "-", "-", "-"),
        ("saved", "saved", "not compared", "-"),
        ("-", "-", "-", "-"),
    ]
    assert isinstance(commands, CodeLines)
    assert commands.text == "symaware branch belief"


def test_causes_that_matter_together_are_named_with_their_command(log: Log, explanation: Explanation, put: Put) -> None:
    together = CandidateSet([BELIEF, FAULT], SAVING, True, "symaware branch both")
    put(replace(explanation, rows=explanation.rows[1:], together=together))
    _, facts, _, _, commands = sections(log)
    assert isinstance(facts, FactTable)
    assert facts.facts["together"].startswith(f"{BELIEF.text}, and {FAULT.text}: 16 of 16")
    assert facts.facts["cause"].endswith("but no single one")
    assert isinstance(commands, CodeLines)
    assert commands.text == "symaware branch both"
    put(replace(explanation, everything=[USELESS], rows=[]))
    _, facts = sections(log)
    assert isinstance(facts, FactTable)
    assert facts.facts["cause"] == "none in awareness or declared faults"


def test_an_explanation_of_another_log_is_not_shown(log: Log, explanation: Explanation, put: Put) -> None:
    put(replace(explanation, digest="0"))
    (fault,) = sections(log)
    assert isinstance(fault, Paragraph)
    assert "explains another log" in str(fault)


def drawn(log: Log) -> list[object]:
    """The marks of causes in a whole replay."""
    view = run_view_of(log)
    scene = Scene(view, detail_of(view, ()), [Causes])
    return [mark for chunk in scene.chunk_reader().chunks(log.messages()) for mark in scene.marks(chunk)]


def test_a_replay_has_a_line_between_the_agents_of_a_cause_until_the_violation(
    log: Log, explanation: Explanation, put: Put
) -> None:
    assert drawn(log) == []
    put(explanation)
    (journal,) = [each for each in drawn(log) if isinstance(each, Journal)]
    assert journal.kinds[0] == "cause"
    assert "saves this run, 16 of 16 futures (placebo 4)" in journal.texts
    (line,) = [each for each in drawn(log) if isinstance(each, Lines)]
    times = np.asarray(line.times)
    assert times.min() == 100_000_000
    np.testing.assert_array_equal(np.asarray(line.counts) > 0, times <= 400_000_000)
    put(replace(explanation, rows=[replace(explanation.rows[0], candidate=replace(BELIEF, about="cart.0"))]))
    (ring,) = [each for each in drawn(log) if isinstance(each, Rings)]
    assert np.asarray(ring.counts).sum() == 7


def test_the_picture_names_cause_candidates_and_what_each_saves(explanation: Explanation, tmp_path: Path) -> None:
    draw_timeline(explanation, tmp_path / "why.svg")
    text = (tmp_path / "why.svg").read_text()
    for words in (
        f"apart, violated at 0.4 s: {BELIEF.noun}",
        BELIEF.text,
        "saves 75 % more futures (at least 50 %)",
        "saves only 1 of 16 futures",
        "not compared",
        "no effect when screened",
    ):
        assert f">{words}<" in text, words


def test_a_picture_that_cannot_be_written_is_reported(explanation: Explanation, tmp_path: Path) -> None:
    for name, said in (("why.txt", "is a file .png, .svg or .pdf"), ("none/why.png", "there is no folder")):
        with pytest.raises(LogError, match=said):
            draw_timeline(explanation, tmp_path / name)
    (tmp_path / "why.pdf").mkdir()
    with pytest.raises(LogError, match="it is a folder"):
        draw_timeline(explanation, tmp_path / "why.pdf")
