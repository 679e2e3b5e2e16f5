"""Bodies of links and joints in Rerun: each surface once, with an instance for each body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from symaware_cli.geometry.articulation import Visual
from symaware_cli.viewing.figure import media_type
from symaware_cli.viewing.rerun.columns import ColumnReceiver, each, flat, turns
from symaware_cli.viewing.scene.marks import Figures, Ground
from symaware_cli.viewing.tessellation import tessellated

#: Colour and half extent of the ground [m], and its offset below its height, so that lines on it are visible [m].
_GROUND = (30, 33, 41)
_GROUND_REACH = 500.0
_BELOW = 2e-3


def show_figures(output: ColumnReceiver, mark: Figures) -> None:
    """Show bodies of links and joints."""
    import rerun as rr

    figure, new = mark.figure, output.is_new(mark.path)
    placed = figure.places(mark.positions, mark.orientations, mark.joints)
    for look in figure.looks:
        path = f"{mark.path}/{figure.visual_path(look[0])}"
        visual, _ = figure.visuals[look[0]]
        if new:
            output.static(path, _surface(visual, mark.colour, mark.surfaces))
        positions = np.concatenate([placed[number][0] for number in look], axis=1)
        orientations = np.concatenate([placed[number][1] for number in look], axis=1)
        # Sent at each instant: Rerun does not combine static scales with poses that change.
        scales = None
        if visual.kind == "mesh" and set(visual.size) != {1.0}:
            scales = flat(np.broadcast_to(visual.size, positions.shape))
        instances = rr.InstancePoses3D.columns(
            translations=flat(positions), quaternions=turns(orientations), scales=scales
        )
        output.send(path, mark.times, instances, each(positions))


def show_ground(output: ColumnReceiver, mark: Ground) -> None:
    """Show a level plane."""
    import rerun as rr

    corners = _GROUND_REACH * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    # With zero normals, the plane is not shaded by light.
    surface = rr.Mesh3D(
        vertex_positions=np.column_stack([corners, np.full(4, mark.height - _BELOW)]),
        triangle_indices=[(0, 1, 2), (0, 2, 3)],
        vertex_normals=np.zeros((4, 3)),
        albedo_factor=_GROUND,
    )
    output.static(mark.path, surface)


def _surface(visual: Visual, colour: Sequence[int], surfaces: Mapping[str, bytes]) -> Any:
    import rerun as rr

    said = visual.colour
    albedo = tuple(round(255 * part) for part in said) if said else (*colour, 255)
    if visual.kind == "mesh":
        return rr.Asset3D(contents=surfaces[visual.mesh], media_type=media_type(visual), albedo_factor=albedo)
    vertices, normals, corners = tessellated(visual)
    return rr.Mesh3D(vertex_positions=vertices, vertex_normals=normals, triangle_indices=corners, albedo_factor=albedo)
