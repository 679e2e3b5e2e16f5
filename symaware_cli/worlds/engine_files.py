"""Files for the PyBullet engine: files that were read and checked, in a form that the engine reads in the same way."""

from __future__ import annotations

import copy
import tempfile
from pathlib import Path
from typing import Self
from xml.etree import ElementTree

from symaware_cli.assets import LARGEST_FILE, SUFFIXES, AssetError, content, is_binary_stl, normalised, parse_mesh, stl
from symaware_cli.assets.asset import Robot
from symaware_cli.core import WorldError

#: The longest path that the engine can take, with the prefixes that it puts before it [bytes].
_LONGEST_PATH = 900


class EngineFiles:
    """Writes files for the engine into a temporary folder, where the original would be misread.

    The engine reads binary STL and plain OBJ, and gets such files by their own paths. It crashes on ASCII STL, reads
    Collada in part, and searches meshes by rules of its own; so it gets the triangles of the former as binary STL, and
    descriptions with absolute paths.
    """

    def __init__(self) -> None:
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._count = 0
        self._meshes: dict[Path, Path] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Delete the files, which the engine needs only while it loads them."""
        if self._folder is not None:
            self._folder.cleanup()

    def mesh(self, path: Path) -> Path:
        """Return the file to load instead of a mesh that was checked.

        Raises:
            WorldError: It cannot be read any more.
        """
        if path not in self._meshes:
            try:
                self._meshes[path] = self._simplified(path)
            except AssetError as error:
                raise WorldError(error.located(path.name)) from error
        return self._meshes[path]

    def robot(self, robot: Robot, pictures: bool) -> Path:
        """Return the file to load instead of a description that was checked.

        Args:
            robot: The description.
            pictures: Whether the engine loads the visual shapes of the robot.
        """
        root = copy.deepcopy(robot.description.root)
        root.set("name", root.get("name") or "robot")  # without one the engine loads nothing
        for element in list(root):
            if element.tag not in ("link", "joint", "material"):
                root.remove(element)
        for link in root.iterfind("link"):
            for visual in list(link.iterfind("visual")):
                mesh = visual.find("geometry/mesh")
                if not pictures or (mesh is not None and self._is_unreadable(robot, mesh)):
                    link.remove(visual)
        for mesh in root.iter("mesh"):
            name = mesh.get("filename") or ""
            if name in robot.paths:
                mesh.set("filename", str(self.mesh(robot.paths[name])))
        return self._write(".urdf", ElementTree.tostring(root, encoding="utf-8"))

    def _is_unreadable(self, robot: Robot, mesh: ElementTree.Element) -> bool:
        return robot.paths[mesh.get("filename") or ""].suffix.lower() not in SUFFIXES

    def _simplified(self, path: Path) -> Path:
        data, suffix = content(path, LARGEST_FILE), path.suffix.lower()
        if suffix == ".stl" and is_binary_stl(data):
            simple = data
        elif suffix == ".obj":
            simple = normalised(data)
        else:
            simple, suffix = stl(parse_mesh(data, suffix).triangles), ".stl"
        if simple == data and path.suffix == suffix and len(str(path).encode()) <= _LONGEST_PATH:
            return path
        return self._write(suffix, simple)

    def _write(self, suffix: str, data: bytes) -> Path:
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="symaware-")
        self._count += 1
        path = Path(self._folder.name) / f"{self._count}{suffix}"
        path.write_bytes(data)
        return path
