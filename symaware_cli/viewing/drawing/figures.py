"""Bodies of links and joints, meshes, and whatever else stands and falls in a world of space, as it truly looks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry.articulation import Visual
from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.figure import Figure, media_type
from symaware_cli.viewing.palette import SCENERY, faded
from symaware_cli.viewing.rerun_output import RerunOutput
from symaware_cli.viewing.tessellation import tessellated
from symaware_cli.viewing.views import GroupView, ObstacleView, RunView

Array = NDArray[np.float64]
Times = NDArray[np.int64]

#: What those look like of whom nothing is said: agents, and entities that move or stay.
_PLAIN = (205, 205, 210)
_STILL = tuple(int(part) for part in faded(np.array(SCENERY, np.uint8), 0.3))
#: The ground, how far it reaches [m], and how far below its height it lies, so that lines on it are seen [m].
_GROUND = (30, 33, 41)
_GROUND_REACH = 500.0
_BELOW = 2e-3


class Figures(Drawing):
    """Groups and entities of which the log has the geometry.

    What a body of some kind looks like is there once, however many of that kind there are: Rerun draws it in as many
    places. Entities without meshes have paths of their own.
    """

    def __init__(self, run_view: RunView, detail: Detail, output: RerunOutput) -> None:
        super().__init__(run_view, detail, output)
        self._begun = False
        users: dict[int, list[GroupView | ObstacleView]] = {}
        everybody: list[GroupView | ObstacleView] = [*run_view.group_views.values(), *run_view.obstacle_views.values()]
        figures = {each.figure.number: each.figure for each in everybody if each.figure}
        for each in everybody:
            if each.figure:
                users.setdefault(each.figure.number, []).append(each)
        #: Where it is drawn, what is drawn there, and who looks like that.
        self._shown: list[tuple[str, Figure, Sequence[GroupView | ObstacleView]]] = []
        for number, like in sorted(users.items()):
            figure = figures[number]
            if (len(like) > 1 and figure.surfaces) or any(isinstance(each, GroupView) for each in like):
                self._shown.append((f"world/figures/{_part(figure.name)}", figure, like))
            else:
                self._shown += [(f"world/scenery/{each.name}", figure, [each]) for each in like]

    def begin(self) -> None:
        """Put up what they look like, and the ground."""
        import rerun as rr

        if self.run_view.ground is not None:
            corners = _GROUND_REACH * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
            plane = np.column_stack([corners, np.full(4, self.run_view.ground - _BELOW)])
            # Without a direction in which it faces, light does not fall on it.
            surface = rr.Mesh3D(
                vertex_positions=plane,
                triangle_indices=[(0, 1, 2), (0, 2, 3)],
                vertex_normals=np.zeros((4, 3)),
                albedo_factor=_GROUND,
            )
            self.output.static("world/ground", surface)
        for path, figure, like in self._shown:
            colour = _PLAIN if isinstance(like[0], GroupView) else like[0].colour if like[0].moves else _STILL
            for first, *_ in figure.looks:
                self.output.static(_path(path, figure, first), self._surface(figure.visuals[first][0], colour))

    def draw(self, chunk: Chunk) -> None:
        """Draw them where they are, whenever one moves."""
        for path, figure, like in self._shown:
            moments = [self._moments(each, chunk) for each in like]
            times = np.unique(np.concatenate(moments))
            if not self._begun and chunk.start not in times[:1]:
                times = np.concatenate([[chunk.start], times])
            if not len(times):
                continue
            placed = [self._placed(each, times, chunk) for each in like]
            for look in figure.looks:
                parts = [each[place] for place in look for each in placed]
                positions = np.concatenate([position for position, _ in parts], axis=1)
                orientations = np.concatenate([orientation for _, orientation in parts], axis=1)
                visual, _ = figure.visuals[look[0]]
                scale = visual.size if visual.kind == "mesh" and set(visual.size) != {1.0} else None
                self.output.instances(_path(path, figure, look[0]), times, positions, orientations, scale)
        self._begun = True

    def _moments(self, who: GroupView | ObstacleView, chunk: Chunk) -> Times:
        topics = [who.whereabouts if isinstance(who, GroupView) else f"/world/{who.name}/state"]
        topics += [f"/world/{who.name}/{kind}" for kind in ("pose", "joints")]
        found = [chunk.frames[topic].times for topic in topics if topic in chunk.frames]
        return np.concatenate([np.empty(0, np.int64), *found])

    def _placed(self, who: GroupView | ObstacleView, times: Times, chunk: Chunk) -> list[tuple[Array, Array]]:
        """Where the visuals of somebody are at some instants: (k, n, 3) [m] and (k, n, 4) each."""
        assert who.figure
        positions, orientations = self.postures(who, times, chunk)
        joints = chunk.frames.get(f"/world/{who.name}/joints")
        values = None
        if joints and joints.before.shape[1] == len(who.figure.articulation.joints):
            values = joints.at(times)
        return who.figure.places(positions, orientations, values)

    def _surface(self, visual: Visual, colour: Sequence[int]) -> Any:
        import rerun as rr

        said = visual.colour
        albedo = tuple(round(255 * part) for part in said) if said else (*colour, 255)
        if visual.kind == "mesh":
            contents = self.run_view.surfaces[visual.mesh]
            return rr.Asset3D(contents=contents, media_type=media_type(visual), albedo_factor=albedo)
        vertices, normals, corners = tessellated(visual)
        return rr.Mesh3D(
            vertex_positions=vertices, vertex_normals=normals, triangle_indices=corners, albedo_factor=albedo
        )


def _path(root: str, figure: Figure, place: int) -> str:
    """The Rerun entity of a visual, and of those that look the same."""
    _, link = figure.visuals[place]
    return f"{root}/{_part(figure.articulation.links[link].name)}/{place}"


def _part(name: str) -> str:
    """A name as a part of a path."""
    return re.sub(r"[^\w.-]", "_", name) or "_"
