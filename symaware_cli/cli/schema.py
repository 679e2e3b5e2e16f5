"""``symaware schema``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from symaware_cli.cli.terminal import WRONG_INPUT, OwnPlugins, fail, say
from symaware_cli.help_place import in_help


@in_help("author", 40)
def schema(
    output: Annotated[Path | None, typer.Option("--output", "-o", help="The file to write.")] = None,
    sweep: Annotated[bool, typer.Option("--sweep", help="The schema of files of sweeps instead.")] = False,
    built_in: Annotated[bool, typer.Option("--built-in", help="Without the plugins of other packages.")] = False,
    plugins: OwnPlugins = None,
) -> None:
    """Write the JSON schema of scenarios (or sweeps) for editors, with the parameters of every installed plugin."""
    import json

    from symaware_cli.cli.plugin_catalogue import with_files
    from symaware_cli.language import Catalogue

    if sweep:
        from symaware_cli.studies.sweep_schema import sweep_schema as described
    else:
        from symaware_cli.language import scenario_schema as described

    content, broken = described(built_in_only=built_in, catalogue=with_files(Catalogue(), plugins or ()))
    text = json.dumps(content, indent=2, ensure_ascii=False) + "\n"
    for problem in broken:
        say(f"symaware: left out: {problem}", err=True)
    if output is None:
        typer.echo(text, nl=False)
        return
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        fail(f"cannot write {output}: {(error.strerror or str(error)).lower()}", WRONG_INPUT)
