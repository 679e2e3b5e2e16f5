"""Warns of meshes that are not convex, in worlds in which the convex hull of a mesh collides."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from symaware_cli.assets import AssetError, AssetFolders, asset, is_convex, read_mesh
from symaware_cli.core import Entity, Obstacle, ScenarioView, WorldError


def warn_of_hulls(view: ScenarioView, folders: AssetFolders) -> None:
    """Warn of each body with a mesh that is not convex, where the scenario names its file.

    Args:
        view: The scenario; takes the warnings.
        folders: The folders to which the names of files are relative.
    """
    convex: dict[Path, bool] = {}
    for section, body in _bodies(view):
        shape = body.shape
        if shape is None or not (shape.mesh or shape.urdf):
            continue
        for path in _meshes(body, folders):
            if path not in convex:
                convex[path] = is_convex(read_mesh(path))
            if not convex[path]:
                whose = "its surface" if shape.mesh else f"the surface of its mesh `{path.name}`"
                said = f"{whose} is not convex, and in this world its convex hull collides"
                expected = "an OBJ with a convex object or group for each part, or several entities"
                view.warn(said, "shape", shape.kind, "file", section=section, code="concave", expected=expected)
                break


def _bodies(view: ScenarioView) -> Iterator[tuple[tuple[str, ...], Entity | Obstacle]]:
    for name, obstacle in view.document.environment.entities.items():
        yield ("environment", "entities", name), obstacle
    for name, agents in view.document.agents.items():
        yield ("agents", name, "entity"), agents.entity


def _meshes(body: Entity | Obstacle, folders: AssetFolders) -> list[Path]:
    """Return the files of the meshes with which a body collides; none if they cannot be read, which others report."""
    shape = body.shape
    assert shape is not None
    try:
        if shape.mesh:
            return [asset.find(shape.mesh.file, folders)]
        assert shape.urdf is not None
        robot = asset.described(shape.urdf.file, folders, missing=shape.urdf.missing)
    except (WorldError, AssetError):
        return []
    return list(dict.fromkeys(robot.paths[each.name] for each in robot.description.meshes if each.collides))
