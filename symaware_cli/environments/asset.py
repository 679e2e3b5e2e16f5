"""Assets: finds and checks the mesh and URDF files that a scenario refers to."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path, PurePosixPath

from symaware_cli.core import WorldError
from symaware_cli.environments.urdf import UrdfError, materials, meshes, parsed

_PACKAGE = "pybullet_data"


def find(file: str, folder: Path, *where: str) -> Path:
    """Return the path of a file.

    Args:
        file: Its path, relative to the folder; or to the package pybullet_data if it begins with that name.
        folder: The scenario's folder.
        where: Path in the scenario, for messages.

    Raises:
        WorldError: It does not exist, or a link leads out of the folder.
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
    """Return whether a file comes with the package pybullet_data."""
    return PurePosixPath(file).parts[:1] == (_PACKAGE,)


def needed(file: str, folder: Path) -> dict[str, bytes]:
    """Return the contents of all files needed to use a file elsewhere, by path relative to the folder.

    These are the file itself, the meshes that it refers to, and their materials and textures. Files of pybullet_data
    are left out, as they are installed everywhere, and so are files that cannot be found.
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
    """Check that a URDF file can be read, and that all its meshes exist within the folder.

    Args:
        path: The path of the file.
        file: Its name in the scenario.
        folder: The scenario's folder.
        where: Path in the scenario, for messages.

    Raises:
        WorldError: It is no XML, describes no robot, or refers to a file that is missing or outside of the folder.
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
    """Return the folder of pybullet_data without importing it."""
    found = importlib.util.find_spec(_PACKAGE)
    if found is None or found.origin is None:
        raise WorldError(f"the package {_PACKAGE} is not installed: pip install 'symaware-cli[pybullet]'", *where)
    return Path(found.origin).parent.resolve()
