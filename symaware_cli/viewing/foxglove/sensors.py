"""Sensor readings for Foxglove: laser scans, and images with the frames and intrinsics of their cameras."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.timestamp_pb2 import Timestamp

from symaware_cli.geometry.rotation import about
from symaware_cli.recording import png
from symaware_cli.recording.sensor_channels import NOTHING
from symaware_cli.viewing.camera import line_of_sight
from symaware_cli.viewing.foxglove import primitives
from symaware_cli.viewing.foxglove.primitives import WORLD
from symaware_cli.viewing.foxglove.scene_updates import SceneUpdates
from symaware_cli.viewing.scene.marks import Images, Rays


def show_rays(updates: SceneUpdates, mark: Rays) -> None:
    """Show scans; those with unevenly spaced rays are omitted, since Foxglove has no message for them."""
    given = zip(mark.times.tolist(), mark.names, mark.angles, mark.distances, mark.poses.tolist(), strict=True)
    for time, name, angles, distances, (x, y, z, heading) in given:
        even = np.linspace(angles[0], angles[-1], len(angles)) if len(angles) else np.ones(1)
        if even.shape != angles.shape or not np.allclose(angles, even):
            continue
        turned = about((0.0, 0.0, 1.0), np.array(heading)).tolist()
        shown = LaserScan(
            timestamp=primitives.timestamp(time),
            frame_id=WORLD,
            # Planar scans are shown from above, at height 0.
            pose=primitives.pose((x, y, z if mark.spatial else 0.0), turned),
            start_angle=angles[0],
            end_angle=angles[-1],
            ranges=distances.tolist(),
        )
        updates.add_message(time, f"/{mark.layer}/{name}", shown)


def show_images(updates: SceneUpdates, mark: Images) -> None:
    """Show images: colour images with frame and intrinsics of the camera, or depth images."""
    topic = f"/{mark.layer}"
    for number, (time, data) in enumerate(zip(mark.times.tolist(), mark.files, strict=True)):
        stamp = primitives.timestamp(time)
        if mark.kind == "depth":
            updates.add_message(time, f"{topic}/depth", _depth(stamp, data, mark.frame))
            continue
        view = float(mark.fields_of_view[number])
        updates.add_message(time, f"/tf/{mark.frame}", _frame(stamp, mark, number))
        updates.add_message(time, f"{topic}/calibration", _calibration(stamp, png.size(data), view, mark.frame))
        seen = CompressedImage(timestamp=stamp, frame_id=mark.frame, data=data, format="png")
        updates.add_message(time, f"{topic}/colour", seen)


def _frame(stamp: Timestamp, mark: Images, number: int) -> FrameTransform:
    """Return the frame of a camera, with x to the right of the image, y downwards and z ahead."""
    from scipy.spatial.transform import Rotation

    position = mark.positions[number]
    aside, above, ahead = line_of_sight(position, mark.targets[number])
    rotation = Rotation.from_matrix(np.stack([aside, -above, ahead], axis=1))
    return FrameTransform(
        timestamp=stamp,
        parent_frame_id=WORLD,
        child_frame_id=mark.frame,
        translation=primitives.vector(position.tolist()),
        rotation=primitives.quaternion(rotation.as_quat().tolist()),
    )


def _calibration(stamp: Timestamp, size: tuple[int, int], field_of_view: float, frame: str) -> CameraCalibration:
    """Return the intrinsics of a pinhole camera with square pixels."""
    width, height = size
    focal = 0.5 * height / np.tan(0.5 * field_of_view)
    lens = np.array([[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]])
    return CameraCalibration(
        timestamp=stamp,
        frame_id=frame,
        width=width,
        height=height,
        K=lens.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=np.column_stack([lens, np.zeros(3)]).ravel().tolist(),
    )


def _depth(stamp: Timestamp, data: bytes, frame: str) -> RawImage:
    """Return depths in mm, 0 without an object, as in ROS (REP 118)."""
    depths = png.decode(data)
    height, width = depths.shape
    millimetres = np.where(depths == NOTHING, 0, depths).astype("<u2")
    return RawImage(
        timestamp=stamp,
        frame_id=frame,
        width=width,
        height=height,
        encoding="16UC1",
        step=2 * width,
        data=millimetres.tobytes(),
    )
