"""A lidar: distances to agents and obstacles along horizontal rays."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup, Scan
from symaware_cli.engine.components.sensor import Sensor, SensorParameters
from symaware_cli.geometry import Array

#: More rays for each agent are surely a mistake.
_MOST = 10_000


class Lidar(Sensor):
    """Measures distances along horizontal rays, which end at other agents and obstacles.

    The rays are cast through the geometry of the world: outlines seen from above in `kinematic`, the shapes of the
    engine in `pymunk` and, at the height of the sensor, in `pybullet`. It stays level when its agent tilts.

    Errors are normal, without bias, and independent of each other.

    It stores its scans among the readings of the group's awareness, under its own name, and updates nothing else: use
    another perception for the own state.
    """

    class Parameters(SensorParameters):
        """Parameters of the sensor."""

        range: float = Field(10.0, gt=0, le=1e6, description="Greatest distance that is measured [m].")
        rays: Annotated[int, Field(ge=1, le=_MOST)] = Field(180, description="How many rays a scan has.")
        field_of_view: float = Field(
            2 * math.pi,
            gt=0,
            le=2 * math.pi,
            description="Angle over which the rays are spread evenly, half to either side of the heading [rad]; full "
            "circle by default.",
        )
        noise: float = Field(0.0, ge=0, description="Standard deviation of the distances [m].")
        position: tuple[float, float, float] = Field(
            (0.0, 0.0, 0.0),
            description="Where the sensor sits on the body: forwards, leftwards, upwards of its position [m].",
        )

    def initialise_component(self, group: AgentGroup) -> None:
        """Compute the directions of the rays."""
        super().initialise_component(group)
        self._angles = angles(self.parameters.rays, self.parameters.field_of_view)
        self._angles.flags.writeable = False

    def measure(self, present: None) -> Scan:
        """Cast the rays of all agents."""
        parameters, group, environment = self.parameters, self._group, self.environment
        snapshot, count = environment.snapshot(), len(self._group)
        positions = snapshot.positions[self._start : self._start + count]
        headings = self._headings()
        forwards, leftwards, upwards = parameters.position
        cosine, sine = np.cos(headings), np.sin(headings)
        origins = positions.copy()
        origins[:, 0] += forwards * cosine - leftwards * sine
        origins[:, 1] += forwards * sine + leftwards * cosine
        facing = headings[:, None] + self._angles
        directions = np.stack([np.cos(facing), np.sin(facing)], axis=2)
        senders = self._start + np.arange(count)
        distances = environment.ray_cast(senders, origins, directions, parameters.range, upwards)
        self._add_noise(distances)
        distances.flags.writeable = False
        poses = np.zeros((count, 4))
        poses[:, :2], poses[:, 3] = origins[:, :2], headings
        poses[:, 2] = environment.body_positions(group.ids)[:, 2] + upwards
        poses.flags.writeable = False
        return Scan(self.now, self._angles, distances, parameters.range, poses, parameters.position)

    def _add_noise(self, distances: Array) -> None:
        """Add errors and dropouts in place; distances that then exceed the range become infinite."""
        parameters, width = self.parameters, distances.shape[1]
        if parameters.noise:
            distances += parameters.noise * self.random.standard_normal(width, "noise")
            np.maximum(distances, 0.0, out=distances)
            distances[distances > parameters.range] = np.inf
        if parameters.dropout:
            distances[self.random.uniform(width, "dropout") < parameters.dropout] = np.nan


def angles(rays: int, field_of_view: float) -> Array:
    """Spread rays over a field of view around the heading; shape (rays,) [rad].

    A full circle begins behind the agent, and its last ray is as far from the first as from its other neighbour.
    """
    if rays == 1:
        return np.zeros(1)
    if field_of_view >= 2 * math.pi:
        return -math.pi + 2 * math.pi * np.arange(rays) / rays
    return np.linspace(-0.5 * field_of_view, 0.5 * field_of_view, rays)
