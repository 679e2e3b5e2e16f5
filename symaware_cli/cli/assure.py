"""``symaware assure``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli.cli import terminal
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.evidence import AssuranceCase


@in_help("check", 47)
def assure(
    case: Annotated[Path, typer.Argument(help="An assurance case in YAML or TOML.", metavar="CASE")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="A new folder for the picture, the XML and the page.", metavar="DIR"),
    ],
    rows: Annotated[int, typer.Option(min=1, help="How many rows of each sweep are made again.")] = 5,
    as_json: terminal.Json = False,
) -> None:
    """Check the evidence of an assurance case, and draw it. Exit status 3 if the top goal is not supported."""
    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        from symaware_cli.evidence import assure

        with terminal.progress_shown("solutions", not as_json) as shown:
            made = assure(case, output, rows=rows, on_progress=shown)
    if as_json:
        terminal.print_json(made.to_json())
    else:
        terminal.say("\n".join([*case_lines(case, made), f"  {'to read':<12} {output / 'index.html'}"]))
    raise typer.Exit(0 if made.is_supported else terminal.VIOLATED)


def case_lines(path: Path, made: AssuranceCase) -> Iterator[str]:
    """Yield the lines of the report on a case."""
    words = {"holds": "supported", "fails": "not supported", "open": "undeveloped"}
    statuses, document = made.statuses, made.document
    yield f"{path}: {words[statuses[document.top]]}"
    for name, goal in document.goals.items():
        yield f"  {name:<12} {words[statuses[name]]}: {terminal.printable(goal.text)}"
    for name, problem in made.problems.items():
        yield f"  {name:<12} {terminal.printable(problem or 'holds')}"
