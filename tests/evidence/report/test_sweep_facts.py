"""Sections of the report of a sweep, each from its folder."""

from pathlib import Path
from typing import Any

import pytest
import yaml

import symaware_cli as sa
from symaware_cli.evidence.report.report_section import ReportSubject
from symaware_cli.evidence.report.sections.sweep_facts import (
    CertificateSection,
    LeastRobustRun,
    SweepFacts,
    SweepShares,
)
from symaware_cli.studies import JOURNAL, SweepFolder, SweepJournal
from symaware_cli.views import CertificateBlock, DataTable, FactTable, Paragraph

SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "tiny",
    "run": {"duration": 0.2},
    "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
    "agents": {
        "robot": {
            "count": 2,
            "model": {"use": "single-integrator", "with": {"process_noise": 0.3}},
            "state": [[0, 0], [1, 0]],
        }
    },
    "specifications": {"apart": {"pairs": "robot", "formula": "always distance > 0"}},
}


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a sweep whose claim is established, and certified, after eight of twenty runs."""
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "tiny.yaml").write_text(yaml.safe_dump(SCENARIO))
    sa.sweep(folder / "tiny.yaml", folder / "out", runs=20, claim="P(apart) > 0.5, sequential")
    assert sa.certify(folder / "out").is_established
    return folder / "out"


@pytest.fixture
def subject(path: Path) -> ReportSubject:
    with SweepJournal(path / JOURNAL) as journal:
        row = next(iter(journal.rows("done")))
    return ReportSubject(path, folder=SweepFolder.opened(path), row=row)


def test_the_facts_are_scenario_runs_and_claim(subject: ReportSubject) -> None:
    assert SweepFacts().applies(subject)
    (table,) = SweepFacts().content(subject)
    assert isinstance(table, FactTable)
    assert str(table.facts["scenario"]).startswith("tiny.yaml, seed of the sweep ")
    assert str(table.facts["runs"]).startswith("8 of 20: 8 done")
    assert table.facts["combinations"] == "1"
    assert table.facts["claim"] == "P(apart) > 0.5 with confidence 0.99, sequential"


def test_each_specification_has_its_share_with_an_interval(subject: ReportSubject) -> None:
    (table,) = SweepShares().content(subject)
    assert isinstance(table, DataTable)
    (row,) = table.rows
    assert row[:4] == ("as it is", "apart", "8 of 8", "1")
    assert " to 1 (" in str(row[4])


def test_the_certificate_is_shown_as_found_or_its_fault(subject: ReportSubject, tmp_path: Path) -> None:
    block, note = CertificateSection().content(subject)
    assert isinstance(block, CertificateBlock)
    assert isinstance(note, Paragraph)
    assert list(CertificateSection().content(ReportSubject(tmp_path))) == []
    (tmp_path / "certificate.json").write_text("{}")
    (fault,) = CertificateSection().content(ReportSubject(tmp_path))
    assert isinstance(fault, Paragraph)
    assert "certificate.json cannot be read" in str(fault)


def test_the_run_that_is_shown_has_its_verdicts_and_the_command_that_repeats_it(subject: ReportSubject) -> None:
    section = LeastRobustRun()
    assert section.applies(subject)
    assert section.heading(subject) == "Run 0, the least robust"
    (text,) = section.content(subject)
    assert "apart satisfied. " in str(text)
    assert "symaware run out --index 0" in str(text)


def test_a_report_of_a_log_has_no_section_about_sweeps(tmp_path: Path) -> None:
    log = ReportSubject(tmp_path / "a.mcap")
    assert not any(each.applies(log) for each in (SweepFacts(), SweepShares(), CertificateSection(), LeastRobustRun()))
