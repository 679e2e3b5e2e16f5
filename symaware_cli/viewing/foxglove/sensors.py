"""What sensors measured, for Foxglove: scans, and images with the frames and lenses of their cameras."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from symaware_cli.recording.sensor_channels import LoggedImage, images, scans
from symaware_cli.viewing.drawing.sensors import line_of_sight
from symaware_cli.viewing.foxglove import entities
from symaware_cli.viewing.foxglove.entities import WORLD
from symaware_cli.viewing.foxglove.output import Output
from symaware_cli.viewing.rerun_output import turned


class Lidar:
    """The scans of the lidars of a group, where these stood as they measured: ``/scan/<agent>/<sensor>``."""

    def __init__(self, sensor: str, agents: Sequence[str], output: Output, *, spatial: bool) -> None:
        self._sensor, self._agents, self._output, self._spatial = sensor, agents, output, spatial

    def take(self, time: int, message: Any) -> None:
        """Show the scans of a message; none whose rays are not spread evenly, as Foxglove has no word for those."""
        for scan in scans(time, message, self._sensor, self._agents):
            even = np.linspace(scan.angles[0], scan.angles[-1], len(scan.angles)) if len(scan.angles) else np.ones(1)
            if even.shape != scan.angles.shape or not np.allclose(scan.angles, even):
                continue
            x, y, z, heading = scan.pose.tolist()
            shown = LaserScan(
                timestamp=entities.timestamp(time),
                frame_id=WORLD,
                # What keeps to a plane is seen from above, at no height.
                pose=entities.pose((x, y, z if self._spatial else 0.0), turned(heading).tolist()),
                start_angle=scan.angles[0],
                end_angle=scan.angles[-1],
                ranges=scan.distances.tolist(),
            )
            self._output.write(f"/scan/{scan.agent}/{self._sensor}", time, shown)


class Camera:
    """The images of the cameras of a group, ``/camera/<agent>/<sensor>/...``, each in a frame ``<agent>/<sensor>``."""

    def __init__(self, sensor: str, agents: Sequence[str], output: Output) -> None:
        self._sensor, self._agents, self._output = sensor, agents, output

    def take(self, time: int, message: Any) -> None:
        """Show an image: colours or depths."""
        for image in images(time, message, self._sensor, self._agents):
            frame = f"{image.agent}/{self._sensor}"
            topic = f"/camera/{frame}"
            stamp = entities.timestamp(time)
            match image.kind:
                case "COLOUR":
                    self._output.write(f"/tf/{frame}", time, _frame(image, frame))
                    self._output.write(f"{topic}/calibration", time, _calibration(image, frame))
                    seen = CompressedImage(timestamp=stamp, frame_id=frame, data=image.data, format="png")
                    self._output.write(f"{topic}/colour", time, seen)
                case "DEPTH":
                    self._output.write(f"{topic}/depth", time, _depth(image, frame))


def _frame(image: LoggedImage, frame: str) -> FrameTransform:
    """Where a camera is, with x to the right of the image, y downwards and z ahead."""
    from scipy.spatial.transform import Rotation

    aside, above, ahead = line_of_sight(image.position, image.target)
    rotation = Rotation.from_matrix(np.stack([aside, -above, ahead], axis=1))
    return FrameTransform(
        timestamp=entities.timestamp(image.time),
        parent_frame_id=WORLD,
        child_frame_id=frame,
        translation=entities.vector(image.position),
        rotation=entities.quaternion(rotation.as_quat().tolist()),
    )


def _calibration(image: LoggedImage, frame: str) -> CameraCalibration:
    """The lens of a pinhole camera, whose pixels are square."""
    width, height = image.size
    focal = 0.5 * height / np.tan(0.5 * image.field_of_view)
    lens = np.array([[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]])
    return CameraCalibration(
        timestamp=entities.timestamp(image.time),
        frame_id=frame,
        width=width,
        height=height,
        K=lens.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=np.column_stack([lens, np.zeros(3)]).ravel().tolist(),
    )


def _depth(image: LoggedImage, frame: str) -> RawImage:
    """Depths in mm, 0 where there is nothing, as ROS has them (REP 118)."""
    depths = image.pixels
    height, width = depths.shape
    millimetres = np.where(np.isfinite(depths), np.rint(1e3 * depths), 0.0).astype("<u2")
    return RawImage(
        timestamp=entities.timestamp(image.time),
        frame_id=frame,
        width=width,
        height=height,
        encoding="16UC1",
        step=2 * width,
        data=millimetres.tobytes(),
    )
