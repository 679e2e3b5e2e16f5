"""``symaware trust``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from symaware_cli.cli.terminal import WRONG_INPUT, Json, fail, print_json, say, trouble_shown
from symaware_cli.help_place import in_help


@in_help("author", 50)
def trust(
    folder: Annotated[
        Path | None, typer.Argument(help="The folder of a scenario; by default the trusted folders are listed.")
    ] = None,
    forget: Annotated[bool, typer.Option("--forget", help="Trust it no longer.")] = False,
    as_json: Json = False,
) -> None:
    """Trust the Python files in a folder, so that scenarios there may use them as plugins, until one changes."""
    from symaware_cli.plugin_files import forget as forget_folder
    from symaware_cli.plugin_files import remember, trusted_folders

    with trouble_shown(as_json):
        if folder is None:
            if forget:
                fail("--forget takes the folder", WRONG_INPUT, as_json)
            _print(trusted_folders(), as_json=as_json)
        elif not forget:
            _print({str(folder.resolve()): remember(folder)}, as_json=as_json)
        elif not forget_folder(folder):
            fail(f"{folder} is not trusted", WRONG_INPUT, as_json)
        elif not as_json:
            say(f"{folder} is no longer trusted")


def _print(folders: Mapping[str, Mapping[str, str]], *, as_json: bool) -> None:
    if as_json:
        print_json(folders)
        return
    for folder, files in folders.items():
        say(f"{folder} is trusted, until one of these files changes:")
        for name, digest in files.items():
            say(f"  {digest[:16]}  {name}")
    if not folders:
        say("No folder is trusted.")
