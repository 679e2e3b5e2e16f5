"""Assets: finds and checks the files of meshes and robots that a scenario refers to.

The readers of these files are imported only for scenarios that refer to such files.

Reasons: docs/decisions/0061-packages-of-robots.md
"""

from __future__ import annotations

import importlib.util
import os
import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Literal

from symaware_cli.assets.asset_error import AssetError
from symaware_cli.core import WorldError
from symaware_cli.world import record

if TYPE_CHECKING:
    from symaware_cli.assets.mjcf import MjcfDescription
    from symaware_cli.assets.urdf import MeshReference, RobotDescription
    from symaware_cli.assets.xml_tree import XmlElement

_PACKAGE = "pybullet_data"

#: Suffixes of robot files: URDF and MJCF.
ROBOTS = (".urdf", ".xml")

#: How collision shapes with missing meshes are handled.
Missing = Literal["refuse", "leave-out"]

#: Prefixes with which URDF files refer to a file of a package: those of ROS and of Gazebo.
_IN_PACKAGE = re.compile(r"(?:package|model)://([^/]+)/(.+)")

#: How much of a package.xml is read to find its name [bytes].
_MOST_OF_MANIFEST = 1 << 16


@record
class AssetFolders:
    """The folders with the files of a scenario.

    Attributes:
        home: The scenario's folder.
        further: Further folders that the scenario names, searched in this order after `home`.
    """

    home: Path
    further: tuple[Path, ...] = ()

    @property
    def roots(self) -> tuple[Path, ...]:
        """All folders, with links resolved."""
        return tuple(each.resolve() for each in (self.home, *self.further))


@record
class Robot:
    """A robot description with the files of its meshes.

    Attributes:
        description: The description.
        paths: The files of the meshes, by the names that the description uses.
        stored: The names of these files in a log, relative to its folder, by the names that the description uses; also
            those of the files that it includes.
        includes: The files that the description includes, by the names that it uses.
        left_out: The reasons for leaving out shapes, as sentences with their places in the file: a visual mesh is
            missing, a collision mesh is missing and may be left out, or a collision shape has the size 0.
    """

    description: RobotDescription | MjcfDescription
    paths: dict[str, Path]
    stored: dict[str, str]
    includes: dict[str, Path]
    left_out: tuple[str, ...] = ()


def find(file: str, folders: AssetFolders, *where: str) -> Path:
    """Return the path of a file.

    Args:
        file: The path relative to one of the folders, or below the package pybullet_data if it begins with that name.
        folders: The folders of the scenario.
        where: Path in the scenario, for messages.

    Raises:
        WorldError: The file does not exist, or a symbolic link leads out of the folder.
    """
    return _located(file, folders, *where)[0]


def _located(file: str, folders: AssetFolders, *where: str) -> tuple[Path, Path]:
    """Return the path of a file, and the folder that it was found in, with links resolved."""
    parts = PurePosixPath(file).parts
    homes, inner = folders.roots, parts
    if parts[0] == _PACKAGE:
        homes, inner = (_package(*where),), parts[1:]
    for home in homes:
        path = home.joinpath(*inner)
        if not path.resolve().is_relative_to(home):
            out = "the scenario's folder" if home == homes[0] else f"{home}"
            raise WorldError(f"`{file}` leads out of {out}", *where)
        if path.is_file():
            return path, home
    place = _PACKAGE if parts[0] == _PACKAGE else "the scenario's folder"
    others = "".join(f", nor in {each}" for each in homes[1:])
    raise WorldError(f"there is no file `{file}` in {place}{others}", *where)


def is_packaged(file: str) -> bool:
    """Return whether a file comes with the package pybullet_data."""
    return PurePosixPath(file).parts[:1] == (_PACKAGE,)


def needed(file: str, folders: AssetFolders) -> dict[str, bytes]:
    """Return the contents of all files needed to use a file elsewhere, by path relative to one folder.

    These are the file itself, the meshes that it refers to, and their materials and textures. Files of pybullet_data
    are left out, as they are installed everywhere, and so are files that cannot be found.
    """
    from symaware_cli.assets.urdf import materials

    if is_packaged(file):
        return {}
    try:
        path, _ = _located(file, folders)
    except WorldError:
        return {}
    found = {str(PurePosixPath(file)): path}
    if path.suffix.lower() in ROBOTS:
        try:
            robot = described(file, folders, missing="leave-out")
        except WorldError:
            pass
        else:
            found |= {robot.stored[name]: each for name, each in (robot.paths | robot.includes).items()}
    looks = {
        os.path.normpath(PurePosixPath(name).parent / look): at.parent / look
        for name, at in found.items()
        for look in materials(at)
    }
    roots = folders.roots
    return {
        name: at.read_bytes()
        for name, at in {**found, **looks}.items()
        if at.is_file() and any(at.resolve().is_relative_to(root) for root in roots) and not name.startswith("..")
    }


def check(file: str, folders: AssetFolders, *where: str, missing: Missing = "refuse") -> None:
    """Check that the file of a mesh or a robot can be used, with everything that it refers to.

    Args:
        file: Its name in the scenario.
        folders: The folders of the scenario.
        where: Path in the scenario, for messages.
        missing: How to handle a robot's collision shapes whose meshes are missing.

    Raises:
        WorldError: It is damaged, or refers to a file that is missing, damaged, or outside of the folders.
    """
    from symaware_cli.assets.mesh_file import check_mesh

    path, home = _located(file, folders, *where)
    if path.suffix.lower() in ROBOTS:
        described(file, folders, *where, missing=missing)
        return
    try:
        check_mesh(path, encloses=True)
        _check_looks(path, (home, *folders.roots))
    except AssetError as error:
        raise WorldError(error.located(file), *where) from error


def described(file: str, folders: AssetFolders, *where: str, missing: Missing = "refuse") -> Robot:
    """Read the file of a robot, URDF or MJCF, and find and check all its meshes.

    Args:
        file: Its name in the scenario.
        folders: The folders of the scenario.
        where: Path in the scenario, for messages.
        missing: How to handle the collision shapes of a URDF file whose meshes are missing.

    Raises:
        WorldError: It is damaged, or refers to a file that is missing, damaged, or outside of the folders.
    """
    from symaware_cli.assets.mjcf import MjcfDescription
    from symaware_cli.assets.urdf import RobotDescription

    path, home = _located(file, folders, *where)
    description: RobotDescription | MjcfDescription
    try:
        search = _Search(path, home, (home, *(each for each in folders.roots if each != home)), missing)
        if path.suffix.lower() == ".urdf":
            description = RobotDescription.read(path)
        else:
            description = MjcfDescription.read(path, search.included)
        needless = [reference.element for reference in description.meshes if not search.find(reference)]
        if isinstance(description, RobotDescription):
            for shape, said in description.empty:
                needless.append(shape)
                search.left_out.append(AssetError(said, shape.line, shape.column))
            if needless:
                description.leave_out(needless)
    except AssetError as error:
        raise WorldError(error.located(file), *where) from error
    left_out = tuple(error.located(file) for error in search.left_out)
    return Robot(description, search.paths, search.stored, search.includes, left_out)


def installed(path: Path, *where: str) -> Robot:
    """Read a URDF file that an installed package brings along, with the meshes in its folder or the one above.

    Args:
        path: The file.
        where: Path in the scenario, for messages.

    Raises:
        WorldError: The file is damaged, or refers to a file that is missing or damaged.
    """
    folder = path.parent
    return described(f"{folder.name}/{path.name}", AssetFolders(folder.parent), *where)


class _Search:
    """Finds the meshes of one description."""

    def __init__(self, path: Path, home: Path, roots: tuple[Path, ...], missing: Missing) -> None:
        self.paths: dict[str, Path] = {}
        self.stored: dict[str, str] = {}
        self.includes: dict[str, Path] = {}
        self.left_out: list[AssetError] = []
        self._path, self._home, self._roots, self._missing = path, home, roots, missing

    def find(self, reference: MeshReference) -> bool:
        """Find and check a mesh; return False if it is missing, and is only visual or may be left out.

        Raises:
            AssetError: The mesh is damaged, outside of the folders, or missing and needed.
        """
        from symaware_cli.assets.mesh_file import SUFFIXES, check_mesh

        name, element = reference.name, reference.element
        if name not in self.paths:
            places = self._places(reference)
            found = next(((at, stored) for at, stored in places if at.is_file()), None)
            if found is None:
                looked = ", ".join(dict.fromkeys(self._shown(at) for at, _ in places))
                said = f"it names the mesh `{name}`, which is not there; looked for {looked}"
                if self._path.suffix.lower() != ".urdf":
                    element.refuse(said)
                if reference.collides and self._missing == "refuse":
                    element.refuse(f"{said}; `missing: leave-out` beside `file` loads the robot without it")
                self.left_out.append(AssetError(said, element.line, element.column))
                return False
            at, stored = found
            if not any(at.resolve().is_relative_to(root) for root in self._roots):
                element.refuse(f"it names the mesh `{name}`, which leads out of its folder")
            self.paths[name], self.stored[name] = at, stored
        at = self.paths[name]
        if at.suffix.lower() not in SUFFIXES:
            if reference.collides:
                element.refuse(f"it names the mesh `{name}`; a collision mesh is an .obj, .stl or .dae file")
            return True
        try:
            check_mesh(at, reference.collides)
            _check_looks(at, self._roots)
        except AssetError as error:
            element.refuse(f"it names the mesh {error.located(name)}")
        return True

    def included(self, element: XmlElement, name: str) -> Path:
        """Return the path of a file that the description includes by a path relative to its own.

        Raises:
            AssetError: The file is missing, or outside of the folders.
        """
        if "\\" in name or "\0" in name or len(name) > 1_000 or "://" in name or name.startswith("/"):
            element.refuse(f"it includes `{name[:60]}`, which is no relative path with `/` between plain names")
        at = Path(os.path.normpath(self._path.parent / name))
        if not at.is_relative_to(self._home) or not any(at.resolve().is_relative_to(root) for root in self._roots):
            element.refuse(f"it includes `{name}`, which leads out of its folder")
        if not at.is_file():
            element.refuse(f"it includes `{name}`, which is not there")
        self.includes[name], self.stored[name] = at, str(at.relative_to(self._home))
        return at

    def _places(self, reference: MeshReference) -> list[tuple[Path, str]]:
        """Return where a mesh may be, the nearest place first, each with its name in a log."""
        name, element = reference.name, reference.element
        if "\\" in name or "\0" in name or len(name) > 1_000:
            element.refuse(f"it names the mesh `{name[:60]}`, which is no path with `/` between plain names")
        matched = _IN_PACKAGE.fullmatch(name)
        if matched is None:
            if "://" in name or name.startswith("/"):
                element.refuse(f"it names the mesh `{name}`; a path is relative to the file, or begins with package://")
            at = Path(os.path.normpath(self._path.parent / name))
            if not at.is_relative_to(self._home):
                element.refuse(f"it names the mesh `{name}`, which leads out of its folder")
            return [(at, str(at.relative_to(self._home)))]
        package, rest = matched.groups()
        if ".." in (*PurePosixPath(rest).parts, package):
            element.refuse(f"it names the mesh `{name}`: `..` leads out of the package")
        return list(dict.fromkeys(self._in_package(package, rest)))

    def _in_package(self, package: str, rest: str) -> Iterator[tuple[Path, str]]:
        """Yield where a file of a package may be: in folders above the description, then in the further ones."""
        # In a log the scenario's folder has another name, and further folders are part of it: a package that would not
        # be recognised there is stored as a folder of its name.
        alone = str(PurePosixPath(package, rest))
        folder = self._path.parent
        above = [folder, *folder.parents]
        for each in above[: above.index(self._home) + 1]:
            inner = each.relative_to(self._home)
            if each.name == package:
                yield each / rest, alone if each == self._home else str(PurePosixPath(inner, rest))
            elif _package_name(each) == package:
                yield each / rest, alone
            yield each / package / rest, str(PurePosixPath(inner, package, rest))
        for root in self._roots[1:]:
            if root.name == package or _package_name(root) == package:
                yield root / rest, alone
            yield root / package / rest, alone
        # Collections of robots often keep a package in a folder of another name. A file name without a folder would
        # match too many files.
        for each in above[: above.index(self._home) + 1] if "/" in rest else ():
            yield each / rest, str(PurePosixPath(each.relative_to(self._home), rest))

    def _shown(self, at: Path) -> str:
        return str(at.relative_to(self._home)) if at.is_relative_to(self._home) else str(at)


def _package_name(folder: Path) -> str | None:
    """Return the name in a folder's package.xml; None without one."""
    file = folder / "package.xml"
    try:
        state = file.stat()
    except OSError:
        return None
    return _manifest_name(file, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=256)
def _manifest_name(file: Path, modified: int, size: int) -> str | None:
    try:
        with open(file, "rb") as opened:
            found = re.search(rb"<name>\s*([^<]*?)\s*</name>", opened.read(_MOST_OF_MANIFEST))
    except OSError:
        return None
    return found[1].decode(errors="replace") if found else None


def _check_looks(path: Path, roots: tuple[Path, ...]) -> None:
    """Check that the materials and textures of a mesh are within the folders; those that are missing are ignored."""
    from symaware_cli.assets.urdf import materials

    for look in materials(path):
        if not any((path.parent / look).resolve().is_relative_to(root) for root in roots):
            raise AssetError(f"its material or texture `{look}` leads out of the folder")


def _package(*where: str) -> Path:
    """Return the folder of pybullet_data without importing it."""
    found = importlib.util.find_spec(_PACKAGE)
    if found is None or found.origin is None:
        raise WorldError(f"the package {_PACKAGE} is not installed: pip install 'symaware-cli[pybullet]'", *where)
    return Path(found.origin).parent.resolve()
