"""The plugins of a scenario's own files; see `symaware_cli.plugin_files`."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath

from symaware_cli.language.assignment import Assignment
from symaware_cli.language.catalogue import Catalogue
from symaware_cli.language.changes import assignments
from symaware_cli.language.compose import compose
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.scenario_section import SECTION
from symaware_cli.world import UserError


class OwnPluginError(UserError):
    """A file of plugins cannot be added to a scenario."""

    status = 2


def with_own_plugins(
    catalogue: Catalogue, diagnosis: Diagnosis, folder: FilePath
) -> tuple[Catalogue, Mapping[str, bytes] | None]:
    """Return the plugins that are installed, with those of the files that a scenario names.

    Args:
        catalogue: The installed plugins.
        diagnosis: Has the composed document, and takes problems.
        folder: The folder of the scenario.

    Returns:
        The plugins, and the content of each file by its path; after a problem those that are installed, and None.
    """
    names = diagnosis.composition.data.get("plugins")
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        return catalogue, {}
    from symaware_cli.plugin_files import PluginFileError, inline_plugins, plugins_of, read_files

    kinds = [kind for name, kind in catalogue.kinds.items() if name != SECTION.name]
    taken = {listing.name for kind in kinds for listing in catalogue.listings(kind.name)}
    files = [name for name in names if not name.startswith("<")]
    try:
        inline = inline_plugins([name[1:-1] for name in names if name.startswith("<")], kinds)
        if not files:
            return catalogue.with_plugins(inline), {}
        read = read_files(folder, files)
        return catalogue.with_plugins([*inline, *plugins_of(read, kinds, taken)]), read.contents
    except PluginFileError as error:
        path, expected = ("plugins", names.index(error.name)), error.expected
        message = str(error)
        if error.code == "untrusted-file":
            message = f"`{error.name}` is code, and it is not trusted"
            expected = f"your consent: read it, then `symaware trust {_folder(diagnosis)}`, or --trust for one command"
        diagnosis.report(error.code, message, path, expected=expected)
        return catalogue, None


def add_plugins(scenario: FilePath, files: Sequence[FilePath], changes: list[Assignment]) -> frozenset[str]:
    """Add files of plugins to those that a scenario names.

    Args:
        scenario: The scenario.
        files: The files.
        changes: Changes to the scenario, which are added to.

    Returns:
        The names of the added files in the scenario.

    Raises:
        ScenarioError: The scenario cannot be read.
        OwnPluginError: A file is not in the folder of the scenario, or the scenario is that of a log.
    """
    if not files:
        return frozenset()
    home, names = FilePath(os.path.realpath(scenario.parent)), []
    if scenario.suffix == ".mcap":
        raise OwnPluginError(f"{scenario} is a log: a plugin is added to a scenario only")
    for file in files:
        path = FilePath(os.path.realpath(file.parent), file.name)
        if not path.is_relative_to(home):
            raise OwnPluginError(f"{file} is not in the folder of {scenario}, nor below it")
        names.append(path.relative_to(home).as_posix())
    named = compose(scenario, changes).data.get("plugins")
    others = named if isinstance(named, list) else []
    changes += assignments({"plugins": [*others, *(name for name in names if name not in others)]})
    return frozenset(names)


def _folder(diagnosis: Diagnosis) -> str:
    """The folder of the scenario as a user would write it; FOLDER if it is that of a log's copy."""
    name = FilePath(diagnosis.composition.name)
    return "FOLDER" if ".mcap:" in name.name else shlex.quote(str(name.parent))
