"""Bodies in Rerun: moving shapes with labels and headings, and bodies of links and joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import Visual, rotated
from symaware_cli.views.figure import media_type
from symaware_cli.views.outline import closed, dashes, outlines, prism_surface
from symaware_cli.views.rerun.columns import ColumnReceiver, each, flat, packed, shades, turns
from symaware_cli.views.rerun.lines import send_strips
from symaware_cli.views.scene.marks import ACTIVE, PAST, TO_COME, Bodies, Figures, Ground, Solid
from symaware_cli.views.tessellation import tessellated

Array = NDArray[np.float64]

#: Share of the background in the filling of an area while it counts, and in its outline by phase.
_FILLING = 0.55
_LOOK = {TO_COME: 0.45, ACTIVE: 0.0, PAST: 0.78}
#: Height of an outline above the filling [m].
_ABOVE = 0.005


def show_bodies(output: ColumnReceiver, mark: Bodies) -> None:
    """Show bodies as their shapes, with labels and headings."""
    import rerun as rr

    path, shape = f"{mark.path}/body", mark.shape
    times, positions, counts, colours = mark.times, mark.positions, each(mark.positions), packed(mark.colours)
    new, static = output.is_new(mark.path), output.static
    if mark.ring is not None:
        centre, radius = mark.ring
        positions = positions + rotated(mark.orientations, centre)
        positions[..., 2] = np.maximum(positions[..., 2], mark.floor)
        if new:
            thick = rr.Radius.ui_points([1.5])
            static(path, rr.Cylinders3D.from_fields(lengths=[0.0], line_radii=thick, fill_mode="majorwireframe"))
        _discs(output, path, mark, positions, radius)
    elif shape and shape.box:
        height = 0.5 * shape.box.upright if mark.spatial else 0.01
        half = [0.5 * shape.box.length, 0.5 * shape.box.width, height]
        if new:
            static(path, rr.Boxes3D.from_fields(half_sizes=[half] * len(mark.names), fill_mode="solid"))
        boxes = rr.Boxes3D.columns(centers=flat(positions), quaternions=turns(mark.orientations), colors=colours)
        output.send(path, times, boxes, counts)
    elif shape and shape.polygon:
        (outline, *_) = outlines(shape.pieces)
        closed = np.pad(np.concatenate([outline, outline[:1]]), ((0, 0), (0, 1)))
        corners = positions[..., None, :] + rotated(mark.orientations[..., None, :], closed)
        lengths = np.full(len(times) * positions.shape[1], len(closed))
        send_strips(output, path, times, corners.reshape(-1, 3), lengths, counts, mark.colours.reshape(-1, 3))
    elif shape and shape.cylinder and mark.spatial:
        if new:
            static(path, rr.Cylinders3D.from_fields(lengths=[shape.cylinder.height], fill_mode="solid"))
        _discs(output, path, mark, positions, shape.radius)
    else:
        if new:
            # The radius of points without a size is in pixels.
            static(path, rr.Points3D.from_fields(radii=[shape.radius] if shape else rr.Radius.ui_points([4.0])))
        output.send(path, times, rr.Points3D.columns(positions=flat(positions), colors=colours), counts)
    output.label(mark, positions)
    if mark.nosed and mark.ring is None and shape is not None:
        _show_noses(output, mark, shape.radius, new=new)


def show_solid(output: ColumnReceiver, mark: Solid) -> None:
    """Show a body as prisms over its outline."""
    import rerun as rr

    if mark.label:
        output.label_area(mark)
    if mark.phases is not None:
        _show_phases(output, mark)
    elif output.is_new(mark.path):
        (colour,) = shades(mark.colour, mark.transparency or mark.faded, 1, output.theme)
        for number, outline in enumerate(mark.outlines):
            vertices, triangles = prism_surface(outline, mark.low, mark.high)
            surface = rr.Mesh3D(vertex_positions=vertices, triangle_indices=triangles, albedo_factor=colour)
            output.static(f"{mark.path}/{number}", surface)
    placed = rr.Transform3D.columns(translation=flat(mark.positions), quaternion=turns(mark.orientations))
    output.send(mark.path, mark.times, placed)


def _show_phases(output: ColumnReceiver, mark: Solid) -> None:
    """Show an area filled while it counts, else as an outline: interrupted while it is to come, faint afterwards."""
    import rerun as rr

    assert mark.phases is not None
    tint, new = np.array(mark.colour, np.uint8), output.is_new(mark.path)
    changes = np.flatnonzero(np.diff(mark.phases, prepend=np.int8(PAST + 1)))
    times, phases = mark.times[changes], mark.phases[changes]
    count = int((phases == ACTIVE).sum())
    for number, outline in enumerate(mark.outlines):
        path, (vertices, triangles) = f"{mark.path}/{number}", prism_surface(outline, mark.low, mark.high)
        if new:
            filling = shades(tint, _FILLING, 1, output.theme)[0]
            output.static(path, rr.Mesh3D.from_fields(triangle_indices=triangles, albedo_factor=filling))
            output.static(f"{path}/outline", rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points([1.5])))
        shape = rr.Mesh3D.columns(vertex_positions=flat(np.tile(vertices, (count, 1))))
        output.send(path, times, shape, len(vertices) * (phases == ACTIVE))
        above = mark.high + _ABOVE
        lines = {phase: (dashes if phase == TO_COME else closed)(outline, above) for phase in _LOOK}
        drawn = [line for phase in phases.tolist() for line in lines[phase]]
        counts = [len(lines[phase]) for phase in phases.tolist()]
        colours = shades(tint, np.repeat([_LOOK[phase] for phase in phases.tolist()], counts), len(drawn), output.theme)
        lengths = [len(line) for line in drawn]
        send_strips(output, f"{path}/outline", times, np.concatenate(drawn), lengths, counts, colours)


def _discs(output: ColumnReceiver, path: str, mark: Bodies, centres: Array, radius: float) -> None:
    import rerun as rr

    radii = np.full(centres.shape[0] * centres.shape[1], radius, np.float32)
    discs = rr.Cylinders3D.columns(centers=flat(centres), radii=radii, colors=packed(mark.colours))
    output.send(path, mark.times, discs, each(centres))


def _show_noses(output: ColumnReceiver, mark: Bodies, radius: float, *, new: bool) -> None:
    """Show headings as lines outward from the centres."""
    import rerun as rr

    path = f"{mark.path}/heading"
    if new:
        output.static(path, rr.LineStrips3D.from_fields(radii=[0.12 * radius]))
    facing = rotated(mark.orientations, np.array([1.0, 0.0, 0.0]))
    # Just above the body, which would hide it from above; of a ball it only stands out, since what is higher is seen
    # further aside.
    top = _top(mark)
    start, above = (0.5, 0.0) if top is None else (0.0, top + 0.05 * radius)
    middle = mark.positions + np.array([0.0, 0.0, above])
    ends = np.stack([middle + start * radius * facing, middle + 1.5 * radius * facing], axis=2)
    count = ends.shape[0] * ends.shape[1]
    colours = np.broadcast_to(np.array(output.theme.ink, np.uint8), (count, 3))
    send_strips(output, path, mark.times, ends.reshape(-1, 3), np.full(count, 2), each(mark.positions), colours)


def _top(mark: Bodies) -> float | None:
    """Return the height of bodies above their centres [m]; None for balls."""
    shape = mark.shape
    if shape is not None and shape.box:
        return 0.5 * shape.box.upright if mark.spatial else 0.01
    if shape is not None and shape.cylinder and mark.spatial:
        return 0.5 * shape.cylinder.height
    return 0.0 if shape is None or shape.polygon else None


#: Half extent of the ground [m], and its offset below its height, so that lines on it are visible [m].
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
        albedo_factor=output.theme.ground,
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
