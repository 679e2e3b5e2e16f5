"""A report is printed by a browser that is installed; where there is none, the error says what to install."""

from pathlib import Path

import pytest
from rerun_files import needs_browser
from typer.testing import CliRunner

from symaware_cli.cli.application import application
from symaware_cli.log.error import LogError, OutputError
from symaware_cli.views.pages.page_printer import print_page


@pytest.fixture
def page(tmp_path: Path) -> Path:
    path = tmp_path / "page.html"
    path.write_text("<!doctype html><title>t</title><h1>A page</h1>")
    return path


@needs_browser
def test_a_page_is_printed_whole_or_not_at_all(page: Path, tmp_path: Path) -> None:
    print_page(page, tmp_path / "page.pdf")
    assert (tmp_path / "page.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(OutputError, match="its folder does not exist"):
        print_page(page, tmp_path / "none" / "page.pdf")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["page.html", "page.pdf"]


def test_without_a_browser_the_error_names_the_packages_to_install(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(LogError, match="apt install chromium"):
        print_page(page, tmp_path / "page.pdf")


def test_a_browser_that_fails_is_reported(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    browser = tmp_path / "chromium"
    browser.write_text("#!/bin/sh\necho no memory >&2\nexit 4\n")
    browser.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OutputError, match="no memory"):
        print_page(page, tmp_path / "page.pdf")
    assert not (tmp_path / "page.pdf").exists()


def test_nothing_is_written_for_a_pdf_by_another_name(tmp_path: Path) -> None:
    arguments = ["report", str(tmp_path / "a.mcap"), "-o", str(tmp_path / "a.html"), "--pdf", str(tmp_path / "a.txt")]
    result = CliRunner().invoke(application, arguments)
    assert result.exit_code == 2
    assert ".pdf" in result.stderr
    assert not list(tmp_path.iterdir())
