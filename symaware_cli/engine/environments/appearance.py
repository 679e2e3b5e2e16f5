"""Appearance: links and visual shapes of the bodies in the spatial world, for replays and logs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path, PurePosixPath

from symaware_cli.assets import asset, material_colour
from symaware_cli.assets.asset import AssetFolders
from symaware_cli.core import EntityGroup, Obstacle, Shape, Wall
from symaware_cli.geometry import Articulation, Link, Visual, about


def appearances(
    groups: Sequence[EntityGroup],
    obstacles: Mapping[str, Obstacle],
    vehicles: Mapping[str, Path],
    folders: AssetFolders,
    height: float,
) -> dict[str, Articulation]:
    """Describe the links and visual shapes of all bodies, by the name of the group or entity.

    Agents whose shape and model refer to no file look like their shape, and are left out.

    Args:
        groups: All groups.
        obstacles: All obstacles by name.
        vehicles: The URDF files of those groups that are vehicles.
        folders: The folders to which the scenario's file names are relative.
        height: Height of shapes without one of their own [m].

    Raises:
        WorldError: A file is missing or invalid.
    """
    shapes = {name: obstacle.shape for name, obstacle in obstacles.items()}
    for group in groups:
        shape = group.entity.shape
        if shape and (shape.mesh or shape.robot):
            shapes[group.name] = shape
    of_shape: dict[Shape, Articulation] = {}
    for shape in shapes.values():
        if shape not in of_shape:
            of_shape[shape] = appearance(shape, folders, height)
    found = {name: of_shape[shape] for name, shape in shapes.items()}
    for name, file in vehicles.items():
        robot = asset.installed(file)
        found[name] = robot.description.articulation(robot.paths, name=file.stem)
    return found


def appearance(shape: Shape, folders: AssetFolders, height: float) -> Articulation:
    """Describe the body of a shape, as `BodyBuilder` makes it.

    Args:
        shape: The shape.
        folders: The folders to which the scenario's file names are relative.
        height: Height of shapes without one of their own [m].

    Raises:
        WorldError: A file that it refers to is missing or invalid.
    """
    if shape.robot:
        robot = asset.described(shape.robot.file, folders, missing=shape.robot.missing)
        return robot.description.articulation(robot.paths, shape.robot.scale, PurePosixPath(shape.robot.file).stem)
    return Articulation(
        name=shape.kind, links=(Link(name=shape.kind, visuals=tuple(_visuals(shape, folders, height))),)
    )


def _visuals(shape: Shape, folders: AssetFolders, height: float) -> Sequence[Visual]:
    if shape.circle:
        return [Visual(kind="sphere", size=(shape.circle.radius,))]
    if shape.cylinder:
        return [Visual(kind="cylinder", size=(shape.cylinder.radius, shape.cylinder.height))]
    if shape.box:
        return [Visual(kind="box", size=(shape.box.length, shape.box.width, shape.box.upright))]
    if shape.polygon:
        return [Visual(kind="prism", size=(height,), outline=shape.polygon.vertices)]
    if shape.mesh:
        file = asset.find(shape.mesh.file, folders)
        return [Visual(kind="mesh", size=(shape.mesh.scale,) * 3, mesh=str(file), colour=material_colour(file))]
    assert shape.wall
    return _segments(shape.wall, height)


def _segments(wall: Wall, height: float) -> list[Visual]:
    """A box for each segment of a wall, and a cylinder for each of its points."""
    visuals = []
    for (x, y), (to_x, to_y) in pairwise(wall.points):
        size = (math.dist((x, y), (to_x, to_y)), wall.thickness, height)
        turned = tuple(about((0.0, 0.0, 1.0), math.atan2(to_y - y, to_x - x)).tolist())
        middle = (0.5 * (x + to_x), 0.5 * (y + to_y), 0.0)
        visuals.append(Visual(kind="box", size=size, position=middle, orientation=turned))
    half = 0.5 * wall.thickness
    ends = dict.fromkeys(wall.points)
    return visuals + [Visual(kind="cylinder", size=(half, height), position=(x, y, 0.0)) for x, y in ends]
