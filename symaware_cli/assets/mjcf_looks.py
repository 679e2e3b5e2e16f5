"""Looks of robots of MJCF: the visual shapes of their bodies."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from symaware_cli.assets.mjcf_defaults import MjcfDefaults
from symaware_cli.assets.mjcf_pose import MjcfPoses, along, numbers_in, quadruple, triple
from symaware_cli.assets.urdf import numbers_of
from symaware_cli.assets.xml_tree import XmlElement
from symaware_cli.geometry import Visual


class MjcfLooks(NamedTuple):
    """Reads the visual shapes of bodies.

    Attributes:
        defaults: The defaults of the file.
        poses: Reads poses.
        colours: The colour of each material, if it has one; red, green, blue and opacity.
        mesh_files: The name of the file of each mesh that has one.
        mesh_scales: The scale factors of each mesh.
    """

    defaults: MjcfDefaults
    poses: MjcfPoses
    colours: Mapping[str | None, tuple[float, ...] | None]
    mesh_files: Mapping[str, str]
    mesh_scales: Mapping[str, tuple[float, ...]]

    def visuals(self, body: XmlElement, around: str, paths: Mapping[str, Path], scale: float) -> tuple[Visual, ...]:
        """Return the visual shapes of a body: those that do not collide if there are any, else all shapes.

        Args:
            body: The body.
            around: The class of defaults of the elements in the body.
            paths: The files of the meshes, by their names; meshes without one are left out.
            scale: Scale factor of all lengths.
        """
        shapes = [(each, self.defaults.attributes(each, around)) for each in body.children("geom")]
        seen = [each for each in shapes if each[1].get("contype") == "0" and each[1].get("conaffinity") == "0"]
        drawn = (self._visual(element, given, paths, scale) for element, given in seen or shapes)
        return tuple(each for each in drawn if each)

    def _visual(
        self, element: XmlElement, given: dict[str, str], paths: Mapping[str, Path], scale: float
    ) -> Visual | None:
        kind = given.get("type", "mesh" if "mesh" in given else "sphere")
        position, orientation = self.poses.pose(element, given)
        colour = numbers_in(element, given, "rgba", 4) if "rgba" in given else None
        colour = colour or self.colours.get(given.get("material"))
        common = {
            "orientation": quadruple(orientation),
            "colour": tuple(min(max(each, 0.0), 1.0) for each in colour) if colour else None,
        }
        if kind == "mesh":
            name = str(given.get("mesh"))
            path = paths.get(self.mesh_files.get(name, ""))
            if path is None:
                return None
            size = tuple(scale * each for each in self.mesh_scales[name])
            return Visual(kind="mesh", size=size, mesh=str(path), position=triple(scale * position), **common)
        sizes = [scale * each for each in numbers_of(element, "size", given["size"], None)]
        if "fromto" in given:
            ends = np.array(numbers_in(element, given, "fromto", 6)).reshape(2, 3)
            half = 0.5 * scale * float(np.linalg.norm(ends[1] - ends[0]))
            position, sizes = ends.mean(axis=0), [*sizes[: 2 if kind in ("box", "ellipsoid") else 1], half]
            common["orientation"] = quadruple(along(ends[1] - ends[0]))
        place = triple(scale * position)
        if kind == "box":
            return Visual(kind="box", size=tuple(2.0 * each for each in sizes[:3]), position=place, **common)
        if kind in ("capsule", "cylinder"):
            return Visual(kind=kind, size=(sizes[0], 2.0 * sizes[1]), position=place, **common)
        # An ellipsoid is drawn as the ball around it.
        return Visual(
            kind="sphere", size=(max(sizes[:3]) if kind == "ellipsoid" else sizes[0],), position=place, **common
        )
