"""A report as one self-contained HTML page, with everything needed to assess and repeat a run or a sweep."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from symaware_cli.entry_points import Listing
from symaware_cli.evidence.report.folder_index import IndexEntry, index_entries
from symaware_cli.evidence.report.report_section import SECTION, ReportSection, ReportSubject
from symaware_cli.language import FilePath
from symaware_cli.log import LogError, open_log, require_writable_file, whole_file
from symaware_cli.studies import JOURNAL, Row, SweepFolder, SweepJournal, is_sweep
from symaware_cli.views import print_page, rendered, require_printing
from symaware_cli.world import InstalledPlugins, code_position, describe

if TYPE_CHECKING:
    from markupsafe import Markup


def write_report(
    path: FilePath, output: FilePath, viewer: bool = False, pdf: FilePath | None = None, recursive: bool = False
) -> Path:
    """Write the report of a log, of the folder of a sweep, or of any other folder.

    The report of a sweep shows its least robust run, which is repeated for this. The report consists of all installed
    sections (``symaware.reports``); a failing section of another package is left out with a `PluginWarning`. The report
    of another folder is an index of all logs and sweeps in it.

    Args:
        path: The log or the folder.
        output: The path of the page; an existing file is replaced.
        viewer: Whether to embed the Rerun viewer with a replay of the run, which takes about 19 MB.
        pdf: A file for the page as printed by a browser; None for no PDF.
        recursive: Whether the index of a folder includes the folders in it.

    Returns:
        The page.

    Raises:
        LogError: There is neither a log nor a sweep, a package or a browser for a PDF is missing, or an argument
            does not go with the path.
        OutputError: The page cannot be written.
    """
    path, output = Path(path), Path(output)
    if pdf is not None:
        require_printing(Path(pdf))
        require_writable_file(pdf)
    sources = [] if path.is_dir() else [path]
    require_writable_file(output, *sources)
    if path.is_dir() and not is_sweep(path):
        if viewer:
            raise LogError(f"the viewer shows one run, and {path} is a folder; report a log in it")
        page = _index(path, output, recursive=recursive)
    elif recursive:
        raise LogError(f"{path} has no folders to search; --recursive goes with a folder of logs and sweeps")
    else:
        page = _report(path, viewer=viewer)
    with whole_file(output, *sources) as partial:
        partial.write_text(page, encoding="utf-8", errors="replace")
    if pdf is not None:
        print_page(output, Path(pdf))
    return output


def _index(folder: Path, output: Path, *, recursive: bool) -> Markup:
    """Return the index of a folder as HTML."""
    entries = index_entries(folder, recursive=recursive)
    links = [_links(folder, entry, output) for entry in entries]
    unreadable = sum(bool(entry.error) for entry in entries)
    name = folder.resolve().name
    return rendered(
        "folder_index.html", name=name, entries=list(zip(entries, links, strict=True)), unreadable=unreadable
    )


def _links(folder: Path, entry: IndexEntry, output: Path) -> dict[str, str]:
    """Return the addresses of a log or a sweep, and of a page about it beside it, relative to the index."""
    file = folder / entry.path
    page = file.with_name(f"{file.stem if entry.kind == 'log' else file.name}.html")
    pages = {"report": page} if page.is_file() and page.resolve() != output.resolve() else {}
    # With `./` before it and in percent signs, no name of a file is an address of another kind.
    return {
        name: "./" + quote(os.fsencode(os.path.relpath(each, output.parent)))
        for name, each in {"file": file, **pages}.items()
    }


def _report(path: Path, *, viewer: bool) -> Markup:
    """Return the report of a log or a sweep as HTML."""
    with _subject(path, viewer=viewer) as subject:
        return rendered("report.html", title=_title(subject), has_viewer=viewer, sections=list(_sections(subject)))


@contextmanager
def _subject(path: Path, *, viewer: bool) -> Iterator[ReportSubject]:
    if not path.is_dir():
        log = open_log(path)
        yield ReportSubject(path, log=log, run=None if log.foreign else log, has_viewer=viewer)
        return
    folder = SweepFolder.opened(path)
    with SweepJournal(folder.path / JOURNAL) as journal:
        row = _least_robust(journal)
    with tempfile.TemporaryDirectory() as temporary:
        run = None
        if row is not None:
            folder.make_again(row.index, Path(temporary, "run.mcap"))
            run = open_log(Path(temporary, "run.mcap"))
        yield ReportSubject(path, folder=folder, run=run, row=row, has_viewer=viewer)


def _title(subject: ReportSubject) -> str:
    found = subject.overview
    if found is None:
        return f"Sweep {subject.path.resolve().name}"
    return subject.path.name if found.foreign else f"{found.name or subject.path.name}: {found.status}"


def _least_robust(journal: SweepJournal) -> Row | None:
    """Return the run with the least robustness; the first finished run if none has a robustness."""
    done = list(journal.rows("done"))
    return min(done, key=lambda row: (min(_known(row), default=float("inf")), row.index), default=None)


def _known(row: Row) -> list[float]:
    return [value for value in row.robustness.values() if value is not None]


def _sections(subject: ReportSubject) -> Iterator[Markup]:
    """Yield each section with content, in order."""
    found = InstalledPlugins([SECTION]).usable(SECTION.name)
    for listing, kind in sorted(found, key=lambda each: (each[1].order, each[0].name)):
        section = _section(kind, listing, subject)
        if section is not None:
            yield section


def _section(kind: type[ReportSection], listing: Listing, subject: ReportSubject) -> Markup | None:
    """Return a section as HTML; None if it does not apply, has no content, or fails and belongs to another package."""
    try:
        section = kind()
        blocks = list(section.content(subject)) if section.applies(subject) else []
        if not blocks:
            return None
        heading = section.heading(subject)
        return rendered("section.html", heading=heading, blocks=blocks, on_paper=section.on_paper)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        if listing.built_in:
            raise
        listing.warn(f"fails: {describe(error)}{code_position(error, beyond=__file__)}")
        return None
