"""Assets: the files that a scenario names, found where they may lie and nowhere else."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path, PurePosixPath

from symaware_cli.core import WorldError
from symaware_cli.environments.urdf import UrdfError, materials, meshes, parsed

_PACKAGE = "pybullet_data"


def find(file: str, folder: Path, *where: str) -> Path:
    """Find a file.

    Args:
        file: Its path, relative to the folder; or to the package pybullet_data, if it begins with that name.
        folder: The scenario's folder.
        where: Where in the scenario it is named, for messages.

    Raises:
        WorldError: It is not there, or a link leads out of the folder.
    """
    parts = PurePosixPath(file).parts
    home, inner = folder.resolve(), parts
    if parts[0] == _PACKAGE:
        home, inner = _package(*where), parts[1:]
    path = home.joinpath(*inner)
    if not path.resolve().is_relative_to(home):
        raise WorldError(f"`{file}` leads out of the scenario's folder", *where)
    if not path.is_file():
        place = _PACKAGE if parts[0] == _PACKAGE else "the scenario's folder"
        raise WorldError(f"there is no file `{file}` in {place}", *where)
    return path


def is_packaged(file: str) -> bool:
    """Whether a file comes with the package pybullet_data."""
    return PurePosixPath(file).parts[:1] == (_PACKAGE,)


def needed(file: str, folder: Path) -> dict[str, bytes]:
    """Return all that it takes to use a file elsewhere, by path relative to the folder.

    That is the file itself, the meshes that it names, and what says how these look.

    What comes with pybullet_data is everywhere, and so is left out; so is what cannot be found.
    """
    parts = PurePosixPath(file).parts
    if parts[0] == _PACKAGE:
        return {}
    path = folder.joinpath(*parts)
    names = [str(PurePosixPath(*parts))]
    if path.suffix.lower() == ".urdf" and path.is_file():
        try:
            named = list(meshes(parsed(path), path))
        except UrdfError:
            named = []
        names += [os.path.normpath(PurePosixPath(*parts[:-1], name.removeprefix("package://"))) for name in named]
    names += [
        os.path.normpath(PurePosixPath(name).parent / looks) for name in names for looks in materials(folder / name)
    ]
    home = folder.resolve()
    found = {name: home / name for name in names}
    return {name: at.read_bytes() for name, at in found.items() if at.is_file() and at.resolve().is_relative_to(home)}


def check_description(path: Path, file: str, folder: Path, *where: str) -> None:
    """See whether a URDF file can be read, and names no file outside of its folder.

    Args:
        path: Where it is.
        file: What the scenario calls it.
        folder: The scenario's folder.
        where: Where in the scenario it is named, for messages.

    Raises:
        WorldError: It is no XML, no robot, or refers to a file that is missing or lies elsewhere.
    """
    try:
        root = parsed(path)
    except UrdfError as error:
        raise WorldError(f"`{file}` {error}", *where) from error
    home = _package(*where) if PurePosixPath(file).parts[0] == _PACKAGE else folder.resolve()
    for name, target in meshes(root, path).items():
        if not target.resolve().is_relative_to(home):
            raise WorldError(f"`{file}` names the mesh `{name}`, which leads out of its folder", *where)
        if not target.is_file():
            raise WorldError(f"`{file}` names the mesh `{name}`, which is not there", *where)


def _package(*where: str) -> Path:
    """The folder of pybullet_data, found without importing it."""
    found = importlib.util.find_spec(_PACKAGE)
    if found is None or found.origin is None:
        raise WorldError(f"the package {_PACKAGE} is not installed: pip install 'symaware-cli[pybullet]'", *where)
    return Path(found.origin).parent.resolve()
