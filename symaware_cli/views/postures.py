"""Poses of bodies in a chunk of a log."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symaware_cli.views.chunk import Chunk
from symaware_cli.views.views import GroupView, ObstacleView

Array = NDArray[np.float64]


def postures_of(who: GroupView | ObstacleView, times: NDArray[np.int64], chunk: Chunk) -> tuple[Array, Array]:
    """Return the poses of the bodies of a group, or of an entity, at some instants of a chunk.

    Returns:
        Positions (k, n, 3) [m] and quaternions x, y, z, w (k, n, 4); NaN for agents where unknown.
    """
    poses = chunk.frames.get(f"/world/{who.name}/pose")
    if poses is not None and poses.before.shape[1] == 7:
        values = poses.at(times)
        return values[..., :3], values[..., 3:]
    if isinstance(who, GroupView):
        frames = chunk.frames.get(who.state_topic)
        count = len(times), len(who.agents)
        states = np.full((*count, len(who.state)), np.nan) if frames is None else frames.at(times)
        return who.positions(states), who.orientations(states)
    frames = chunk.frames.get(f"/world/{who.name}/state")
    values = np.full((len(times), 1, 3), np.nan) if frames is None else frames.at(times)
    known = np.isfinite(values[..., -1:])
    headings = np.where(known[..., 0], values[..., -1], who.heading)
    return np.where(known, who.positions(values), who.position), who.orientations(headings)
