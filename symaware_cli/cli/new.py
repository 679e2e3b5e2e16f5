"""``symaware new``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from symaware_cli.cli.terminal import WRONG_INPUT, fail
from symaware_cli.help_place import in_help


@in_help("author", 10)
def new(
    name: Annotated[str, typer.Argument(help="Name of the scenario and of the file.")],
    toml: Annotated[bool, typer.Option("--toml", help="Write TOML instead of YAML.")] = False,
) -> None:
    """Write a commented scenario to start from."""
    from symaware_cli.language.template import TemplateError, template

    try:
        content = template(name, toml=toml)
    except TemplateError as error:
        fail(str(error), WRONG_INPUT)
    path = Path(f"{name}.toml" if toml else f"{name}.yaml")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(content)
    except FileExistsError:
        fail(f"{path} exists already", WRONG_INPUT)
    except OSError as error:
        fail(f"cannot write {path}: {(error.strerror or str(error)).lower()}", WRONG_INPUT)
    typer.echo(f"Wrote {path}. Run it with: symaware run {path}")
