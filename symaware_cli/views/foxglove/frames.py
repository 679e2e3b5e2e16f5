"""Bodies in Foxglove: each has a moving frame, with its primitives attached."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from numpy.typing import NDArray

from symaware_cli.assets import AssetError, parse_mesh
from symaware_cli.geometry import Visual
from symaware_cli.views.foxglove import primitives
from symaware_cli.views.foxglove.output import SceneUpdates
from symaware_cli.views.foxglove.primitives import ORIGIN, WORLD, colour, entity, pose, vector
from symaware_cli.views.outline import circle, closed, dashes, outlines
from symaware_cli.views.palette import faded
from symaware_cli.views.scene.marks import ACTIVE, PAST, TO_COME, Bodies, Figures, Solid
from symaware_cli.views.tessellation import tessellated

Array = NDArray[np.float64]

#: Size of a body without a shape [m].
_POINT = 0.2
#: Change of a colour at which bodies are sent again.
_VISIBLE = 8
_NOSE = (240, 240, 240)
#: Opacity of the outline of an area that does not count at present, and its width [pixels].
_OUTLINE_LEFT, _OUTLINE_WIDTH = {TO_COME: 0.6, PAST: 0.25}, 1.5


def show_bodies(updates: SceneUpdates, mark: Bodies) -> None:
    """Show bodies: frames at each instant, and primitives whenever a colour visibly changes."""
    owner = mark.path.rpartition("/")[2]
    if mark.ring is None:
        _move(updates, f"/tf/{owner}", mark.times, mark.names, mark.positions, mark.orientations)
    shown: NDArray[np.int16] | None = updates.kept.get(mark.path)
    for time, colours in zip(mark.times.tolist(), mark.colours.astype(np.int16), strict=True):
        if shown is None:
            labels = [_label(mark, row, text, time) for row, text in mark.labels.items()]
            updates.set_entities(time, f"/labels/{owner}", mark.path, labels)
        if shown is None or (np.abs(colours - shown) >= _VISIBLE).any():
            made = [_body(mark, row, colour(tint), time) for row, tint in enumerate(colours.tolist())]
            updates.set_entities(time, f"/{mark.layer}", mark.path, made)
            shown = colours
    updates.kept[mark.path] = shown


def show_solid(updates: SceneUpdates, mark: Solid) -> None:
    """Show a body that extends upright over its outline."""
    phases = np.zeros(len(mark.times), np.int8) if mark.phases is None else mark.phases
    for time, phase in zip(mark.times.tolist(), phases.tolist(), strict=True):
        if updates.kept.get(mark.path) != phase:
            updates.kept[mark.path] = phase
            updates.set_entities(time, f"/{mark.layer}", mark.path, [_area(mark, time, phase)])
    positions, orientations = mark.positions[:, None], mark.orientations[:, None]
    _move(updates, f"/tf/{mark.name}", mark.times, [mark.name], positions, orientations)


def _area(mark: Solid, time: int, phase: int) -> SceneEntity:
    """Return a body or an area, filled or as an outline, attached to its frame."""
    made = entity(mark.name, time, mark.name)
    if phase != ACTIVE:
        lines = [
            line for outline in mark.outlines for line in (dashes if phase == TO_COME else closed)(outline, mark.high)
        ]
        shade = colour(mark.colour, _OUTLINE_LEFT[phase])
        made.lines.extend(primitives.line(line, shade, _OUTLINE_WIDTH) for line in lines)
        return made
    shade = colour(faded(np.array(mark.colour), mark.faded).tolist(), 1.0 - mark.transparency)
    made.triangles.extend(primitives.prisms(mark.outlines, mark.low, mark.high, shade))
    if mark.label:
        made.texts.append(_text(mark.label, mark.high, mark.colour))
    return made


def show_figures(updates: SceneUpdates, mark: Figures) -> None:
    """Show bodies of links and joints, with a frame ``<body>/<link>`` for each link."""
    figure = mark.figure
    links = figure.articulation.links
    if mark.path not in updates.kept:
        updates.kept[mark.path] = True
        parts = {place: SceneEntity() for place in sorted({place for _, place in figure.visuals})}
        for visual, place in figure.visuals:
            _add(parts[place], visual, mark.surfaces, colour(mark.colour))
        time, made = int(mark.times[0]), []
        for body in (body for _, bodies in mark.owners for body in bodies):
            for place, part in parts.items():
                # The base has the frame of the body.
                frame = f"{body}/{links[place].name}" if place else body
                made.append(entity(frame, time, frame))
                made[-1].MergeFrom(part)
        updates.set_entities(time, f"/{mark.layer}", mark.path, made)
    places = [place for place in sorted({place for _, place in figure.visuals}) if place]
    first = 0
    for owner, bodies in mark.owners:
        some = slice(first, first + len(bodies))
        first = some.stop
        _move(updates, f"/tf/{owner}", mark.times, bodies, mark.positions[:, some], mark.orientations[:, some])
        if places:
            inner, turned = figure.articulation.frames(mark.joints[:, some])
            names = [f"{body}/{links[place].name}" for body in bodies for place in places]
            shape = (len(mark.times), len(names))
            given = inner[..., places, :].reshape(*shape, 3), turned[..., places, :].reshape(*shape, 4)
            parents = [body for body in bodies for _ in places]
            _move(updates, f"/tf/{owner}/links", mark.times, names, *given, parents)


def _move(
    updates: SceneUpdates,
    topic: str,
    times: NDArray[np.int64],
    names: Sequence[str],
    positions: Array,
    orientations: Array,
    parents: Sequence[str] | None = None,
) -> None:
    """Send the poses of frames, (k, n, 3) [m] and (k, n, 4). Unknown poses are omitted."""
    known = np.asarray(np.isfinite(np.concatenate([positions, orientations], axis=2)).all(axis=2))
    for instant, time in enumerate(times.tolist()):
        at, turned = positions[instant].tolist(), orientations[instant].tolist()
        transforms = [
            FrameTransform(
                timestamp=primitives.timestamp(time),
                parent_frame_id=parents[row] if parents else WORLD,
                child_frame_id=names[row],
                translation=vector(at[row]),
                rotation=primitives.quaternion(turned[row]),
            )
            for row in np.flatnonzero(known[instant]).tolist()
        ]
        if transforms:
            updates.add_message(time, topic, FrameTransforms(transforms=transforms))


def _body(mark: Bodies, row: int, shade: Color, time: int) -> SceneEntity:
    """Return a body, attached to its frame, with an arrow along its x axis."""
    made = entity(mark.names[row], time, mark.names[row])
    if mark.ring is not None:
        centre, reach = mark.ring
        made.lines.append(primitives.line(centre + np.pad(circle(reach), ((0, 0), (0, 1))), shade, 2.0))
        return made
    shape, radius = mark.shape, mark.shape.radius if mark.shape else 0.5 * _POINT
    height = radius
    if shape is None or (shape.circle and mark.spatial):
        made.spheres.append(SpherePrimitive(pose=ORIGIN, size=vector([2.0 * radius] * 3), color=shade))
    elif shape.circle or shape.cylinder:
        height = shape.cylinder.height if shape.cylinder and mark.spatial else radius
        size = vector([2.0 * radius, 2.0 * radius, height])
        made.cylinders.append(CylinderPrimitive(pose=ORIGIN, size=size, bottom_scale=1.0, top_scale=1.0, color=shade))
    elif shape.box:
        height = shape.box.height or 0.5 * min(shape.box.length, shape.box.width)
        size = vector([shape.box.length, shape.box.width, height])
        made.cubes.append(CubePrimitive(pose=ORIGIN, size=size, color=shade))
    else:
        made.triangles.extend(primitives.prisms(outlines(shape.pieces), -0.5 * height, 0.5 * height, shade))
    if mark.nosed:
        made.arrows.append(_arrow(radius, height))
    return made


def _arrow(radius: float, height: float) -> ArrowPrimitive:
    """Return an arrow on top of a body that shows its heading."""
    return ArrowPrimitive(
        pose=pose((0.0, 0.0, 0.5 * height)),
        shaft_length=radius,
        shaft_diameter=0.16 * radius,
        head_length=0.5 * radius,
        head_diameter=0.4 * radius,
        color=colour(_NOSE),
    )


def _label(mark: Bodies, row: int, text: str, time: int) -> SceneEntity:
    """Return the label beside a body."""
    made = entity(mark.names[row], time, mark.names[row])
    made.texts.append(_text(text, 2.0 * (mark.extent or 0.5 * _POINT), mark.label_colours[row]))
    return made


def _text(text: str, height: float, tint: Iterable[int]) -> TextPrimitive:
    """Return a text above the origin of a frame."""
    at, shade = pose((0.0, 0.0, height)), colour(tint)
    return TextPrimitive(pose=at, billboard=True, font_size=12.0, scale_invariant=True, color=shade, text=text)


def _add(made: SceneEntity, visual: Visual, surfaces: Mapping[str, bytes], shade: Color) -> None:
    """Add the primitives of a visual to an entity."""
    at, size = pose(visual.position, visual.orientation), visual.size
    if visual.colour:
        *parts, opacity = visual.colour
        shade = colour([round(255 * part) for part in parts], opacity)
    match visual.kind:
        case "box":
            made.cubes.append(CubePrimitive(pose=at, size=vector(size), color=shade))
        case "sphere":
            made.spheres.append(SpherePrimitive(pose=at, size=vector([2.0 * size[0]] * 3), color=shade))
        case "cylinder":
            extents: dict[str, Any] = {"size": vector((2.0 * size[0], 2.0 * size[0], size[1]))}
            made.cylinders.append(CylinderPrimitive(pose=at, bottom_scale=1.0, top_scale=1.0, color=shade, **extents))
        case "mesh":
            # As triangles: for a mesh file, Foxglove would ask the user which axis points up.
            # A log of another program may have meshes that are not read here.
            with suppress(AssetError):
                found = parse_mesh(surfaces[visual.mesh], PurePosixPath(visual.mesh).suffix)
                made.triangles.append(_surface(found.vertices * size, found.corners, visual, shade))
        case _:
            solid = tessellated(visual)
            made.triangles.append(_surface(solid.vertices, solid.corners, visual, shade))


def _surface(vertices: Array, corners: NDArray[np.integer], visual: Visual, shade: Color) -> TriangleListPrimitive:
    return TriangleListPrimitive(
        pose=pose(visual.position, visual.orientation),
        points=primitives.point_list(vertices),
        indices=corners.ravel().tolist(),
        color=shade,
    )
