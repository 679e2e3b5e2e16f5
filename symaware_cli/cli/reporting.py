"""``symaware report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from symaware_cli.cli.terminal import Json, output_kept, print_json, say, trouble_shown
from symaware_cli.help_place import in_help


@in_help("look", 60)
def report(
    path: Annotated[Path, typer.Argument(help="A log, the folder of a sweep, or any folder.", metavar="PATH")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The page, by default named after the log or the folder.", metavar="FILE"),
    ] = None,
    viewer: Annotated[
        bool,
        typer.Option("--viewer", help="Include the Rerun viewer with a replay of the run, about 19 MB."),
    ] = False,
    pdf: Annotated[
        Path | None,
        typer.Option("--pdf", help="Also write the page as PDF, with Chromium, Chrome or Edge.", metavar="FILE"),
    ] = None,
    recursive: Annotated[
        bool, typer.Option("--recursive", help="Include logs and sweeps in the folders of a folder.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Write a page of HTML that needs no network: what ran, a map to play, figures, verdicts; or a folder's index."""
    with trouble_shown(as_json), output_kept(as_json):
        from symaware_cli.api import size_in_words
        from symaware_cli.evidence import write_report
        from symaware_cli.language import unused_path

        name = path.resolve().name if path.is_dir() else path.stem
        page = write_report(path, output or unused_path(name, suffix=".html"), viewer, pdf, recursive)
        files = [page, *([pdf] if pdf else [])]
        sizes = [file.stat().st_size for file in files]
    if as_json:
        printed = {"pdf": str(pdf), "pdf_size": sizes[1]} if pdf else {}
        print_json({"source": str(path), "file": str(page), "size": sizes[0], **printed})
    else:
        for file, size in zip(files, sizes, strict=True):
            say(f"{file}: {size_in_words(size)}")
