"""Geometry in a log: the links and visuals of bodies, with each kind of body and each mesh stored once."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from symaware_cli.assets import MEDIA_TYPES, AssetError, parse_mesh, stl
from symaware_cli.core import Environment
from symaware_cli.geometry import Articulation, Visual, rotated
from symaware_cli.log.error import LogError
from symaware_cli.log.json_text import read_json
from symaware_cli.log.log_schema import GEOMETRY

if TYPE_CHECKING:
    from symaware_cli.geometry import Link

#: Maximum size of a mesh, and of all meshes together [bytes]; a mesh beyond is replaced by its bounding box.
LARGEST = 16 << 20
LARGEST_TOGETHER = 64 << 20


@dataclass
class Geometry:
    """The appearance of the bodies of a spatial world.

    Attributes:
        articulations: Each kind of body once; meshes are named by their attachments.
        bodies: Index in `articulations` by group or entity.
        heights: Height [m] of groups and entities whose position is two-dimensional.
        ground: Height of the ground plane [m]; None if there is none.
    """

    articulations: list[Articulation] = field(default_factory=list)
    bodies: dict[str, int] = field(default_factory=dict)
    heights: dict[str, float] = field(default_factory=dict)
    ground: float | None = None

    def of(self, name: str) -> Articulation | None:
        """Return the articulation of a group or an entity; None if its shape describes it."""
        return self.articulations[self.bodies[name]] if name in self.bodies else None


class GeometryWriter:
    """Collects the geometry of a world for a log.

    Attributes:
        attachments: Media type and content by name, in the order in which they are written.
        notes: Descriptions of the omitted geometry.
    """

    def __init__(self, environment: Environment, files: Mapping[str, bytes]) -> None:
        """Collect the geometry; it is empty for planar worlds.

        Args:
            environment: The initialised world.
            files: The files of the scenario's folder that the log contains, by relative path.
        """
        self.attachments: dict[str, tuple[str, bytes]] = {}
        self.notes: list[str] = []
        self._files, self._folder = files, environment.folder
        self._total = 0
        #: For each path of a mesh: its attachment, or the box that replaces it.
        self._known: dict[str, Visual | str | None] = {}
        described = environment.articulations()
        if not described and environment.ground is None:
            return
        geometry = Geometry(ground=environment.ground)
        places: dict[Articulation, int] = {}
        for name in sorted(described):
            articulation = described[name]
            if articulation not in places:
                places[articulation] = len(places)
                geometry.articulations.append(self._written(articulation))
            geometry.bodies[name] = places[articulation]
        for group in environment.groups:
            if len(group.model.position) == 2:
                geometry.heights[group.name] = float(environment.body_positions(group.ids[:1])[0, 2])
        for name in environment.obstacles:
            if len(environment.pose(name).position) == 2:
                geometry.heights[name] = float(environment.body_positions([name])[0, 2])
        self.attachments = {GEOMETRY: ("application/json", _serialised(geometry)), **self.attachments}

    def _written(self, articulation: Articulation) -> Articulation:
        return articulation.model_copy(update={"links": tuple(map(self._link, articulation.links))})

    def _link(self, link: Link) -> Link:
        visuals = [self._visual(visual) if visual.kind == "mesh" else visual for visual in link.visuals]
        return link.model_copy(update={"visuals": tuple(visual for visual in visuals if visual)})

    def _visual(self, visual: Visual) -> Visual | None:
        """Refer to a mesh by its attachment; replace it by its bounding box if it has none, or drop it if unknown."""
        if visual.mesh not in self._known:
            self._known[visual.mesh] = self._attach_mesh(Path(visual.mesh))
        known = self._known[visual.mesh]
        if isinstance(known, str):
            return visual.model_copy(update={"mesh": known})
        if known is None:
            return None
        scale = np.array(visual.size)
        middle = visual.position + rotated(visual.orientation, scale * known.position)
        size = tuple((np.abs(scale) * known.size).tolist())
        changed: dict[str, Any] = {"kind": "box", "size": size, "mesh": "", "position": tuple(middle.tolist())}
        return visual.model_copy(update=changed)

    def _attach_mesh(self, path: Path) -> Visual | str | None:
        """Attach a mesh; return its attachment, or the box that replaces it."""
        own = self._of_scenario(path)
        if own is None and not path.is_file():
            self.notes.append(f"the mesh {path.name} is left out: it is not there")
            return None
        data, suffix = self._files[own] if own else path.read_bytes(), path.suffix.lower()
        try:
            if suffix == ".dae":
                own, data, suffix = None, stl(parse_mesh(data, suffix).triangles), ".stl"
        except AssetError as error:
            self.notes.append(f"the mesh {error.located(path.name)}; it is left out")
            return None
        if suffix not in MEDIA_TYPES:
            why = f"viewers know no {suffix or 'such'} files"
        elif own:
            return f"scenario/{own}"
        elif len(data) > LARGEST or self._total + len(data) > LARGEST_TOGETHER:
            why = f"it has {len(data) / (1 << 20):.1f} MiB"
        else:
            self._total += len(data)
            return self._add_attachment(path.stem, path.suffix if suffix == path.suffix.lower() else suffix, data)
        box = _bounds(data, suffix)
        stands = "is left out" if box is None else "is drawn as the box around it"
        self.notes.append(f"the mesh {path.name} {stands}: {why}")
        if box is None:
            return None
        low, high = box
        return Visual(kind="box", size=tuple((high - low).tolist()), position=tuple((0.5 * (low + high)).tolist()))

    def _add_attachment(self, stem: str, suffix: str, data: bytes) -> str:
        name, number = f"geometry/{stem}{suffix}", 1
        while name in self.attachments:
            number += 1
            name = f"geometry/{stem}-{number}{suffix}"
        self.attachments[name] = (MEDIA_TYPES[suffix.lower()], data)
        return name

    def _of_scenario(self, path: Path) -> str | None:
        """Return the path of a file relative to the scenario's folder, if the log contains it from there."""
        for folder in (self._folder, self._folder.resolve()):
            if path.is_relative_to(folder) and (inner := str(PurePosixPath(path.relative_to(folder)))) in self._files:
                return inner
        return None


def geometry_of(attachments: Mapping[str, bytes], where: object = "the log") -> Geometry:
    """Read the geometry from the attachments of a log.

    Args:
        attachments: Content by name.
        where: The log, for error messages.

    Raises:
        LogError: The geometry is damaged.
    """
    if GEOMETRY not in attachments:
        return Geometry()
    try:
        content = read_json(attachments[GEOMETRY])
        geometry = Geometry(
            articulations=[Articulation.model_validate(each) for each in content["articulations"]],
            bodies={str(name): int(place) for name, place in content["bodies"].items()},
            heights={str(name): float(height) for name, height in content["heights"].items()},
            ground=None if content["ground"] is None else float(content["ground"]),
        )
        if any(not 0 <= place < len(geometry.articulations) for place in geometry.bodies.values()):
            raise ValueError("it names bodies that it does not describe")
    except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
        raise LogError(f"{GEOMETRY} in {where} is damaged") from error
    return geometry


def _bounds(data: bytes, suffix: str) -> tuple[Any, Any] | None:
    """Return the bounding box of a mesh; None if it cannot be read."""
    try:
        return parse_mesh(data, suffix).bounds()
    except AssetError:
        return None


def _serialised(geometry: Geometry) -> bytes:
    content = {
        "ground": geometry.ground,
        "bodies": geometry.bodies,
        "heights": geometry.heights,
        "articulations": [each.model_dump(mode="json", exclude_defaults=True) for each in geometry.articulations],
    }
    return json.dumps(content, separators=(",", ":")).encode()
