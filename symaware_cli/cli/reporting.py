"""``symaware report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from symaware_cli.cli.terminal import INTERRUPTED, Json, fail, output_kept, print_json, trouble_shown


def report(
    path: Annotated[Path, typer.Argument(help="A log, or the folder of a sweep.", metavar="PATH")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The page, by default named after the log or the folder.", metavar="FILE"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a page of HTML that needs no network: what ran, a map to play, figures, verdicts, how to repeat it."""
    with trouble_shown(as_json), output_kept(as_json):
        from symaware_cli.api.html_report import write_report
        from symaware_cli.api.report import size_in_words
        from symaware_cli.scenario.files import unused_path

        name = path.resolve().name if path.is_dir() else path.stem
        try:
            page = write_report(path, output or unused_path(name, suffix=".html"))
        except KeyboardInterrupt:
            fail(f"{path}: interrupted", INTERRUPTED, as_json)
        size = page.stat().st_size
    if as_json:
        print_json({"source": str(path), "file": str(page), "size": size})
    else:
        typer.echo(f"{page}: {size_in_words(size)}")
