"""Frames for Foxglove: where bodies are, and how they are turned."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from numpy.typing import NDArray

from symaware_cli.recording import wire
from symaware_cli.recording.index import ChannelInfo
from symaware_cli.viewing.foxglove import entities
from symaware_cli.viewing.foxglove.entities import WORLD
from symaware_cli.viewing.foxglove.output import Output
from symaware_cli.viewing.views import ObstacleView

Array = NDArray[np.float64]
Take = Callable[[int, Any], None]


def transforms_of(
    time: int, names: Sequence[str], positions: Array, rotations: NDArray[np.floating]
) -> FrameTransforms:
    """Where everything is, (n, 3) [m], and how it is turned, (n, 4) x, y, z, w. Who is nowhere yet is left out."""
    known = np.isfinite(positions).all(axis=1) & np.isfinite(rotations).all(axis=1)
    return FrameTransforms(
        transforms=[
            FrameTransform(
                timestamp=entities.timestamp(time),
                parent_frame_id=WORLD,
                child_frame_id=names[row],
                translation=entities.vector(positions[row].tolist()),
                rotation=entities.quaternion(rotations[row].tolist()),
            )
            for row in np.flatnonzero(known).tolist()
        ]
    )


def movers(obstacle_view: ObstacleView, channels: Mapping[str, ChannelInfo], output: Output) -> Mapping[str, Take]:
    """What moves an entity of the environment: how it is turned in space, where that is known, or else its heading."""

    def by_pose(time: int, message: wire.Rows) -> None:
        values = message.values
        output.write(
            f"/tf/{obstacle_view.name}", time, transforms_of(time, [obstacle_view.name], values[:, :3], values[:, 3:])
        )

    def by_state(time: int, message: wire.Rows) -> None:
        values = message.values
        transforms = transforms_of(
            time, [obstacle_view.name], obstacle_view.positions(values), obstacle_view.orientations(values[:, -1])
        )
        output.write(f"/tf/{obstacle_view.name}", time, transforms)

    return {"pose": by_pose} if f"/world/{obstacle_view.name}/pose" in channels else {"state": by_state}
