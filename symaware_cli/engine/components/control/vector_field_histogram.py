"""Vector field histograms: drives in the free direction of a scan that costs least.

Reasons: docs/decisions/0087-sensing.md
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from symaware_cli.engine.components.control.free_direction import DirectionCosts, free_directions
from symaware_cli.engine.components.control.scan_steering import ScanSteering
from symaware_cli.engine.components.scan_surfaces import NearReturns, believed_pose
from symaware_cli.geometry import Array

#: Surfaces at right angles to the motion, and behind it, do not limit the speed.
_AHEAD = 1e-6


class VectorFieldHistogram(ScanSteering):
    """Drives to a goal, or along waypoints, by the returns of a lidar.

    Each return within `range` blocks the directions in which a disc around the body, widened by the margin, would touch
    it. Of the free ones the agent takes that with the least cost: the weighted differences from the direction of the
    target, from the heading, and from the direction chosen before (VFH+: I. Ulrich, J. Borenstein, "VFH+: reliable
    obstacle avoidance for fast mobile robots", ICRA 1998; directions are blocked by single returns here, not by the
    density of a grid). Differences to the left count a tenth more, so that two that meet pass each other on the right.

    The speed is such that the distance to each surface, along the straight line to it, would take at least `headway` to
    use up. So an agent stops in front of obstacles that do not give way, and two of them if the headway is at least
    twice the time between two scans. If all directions are blocked, it stands still.

    The model follows the velocity as well as it can; `margin` has to cover the difference.
    """

    class Parameters(ScanSteering.Parameters):
        """Directions and their costs."""

        sectors: int = Field(72, ge=8, le=720, description="How many directions are compared.")
        headway: float = Field(0.6, gt=0, description="In what time a distance may at most be used up [s].")
        target_weight: float = Field(5.0, gt=0, description="Cost of the difference from the direction of the target.")
        heading_weight: float = Field(2.0, ge=0, description="Cost of the difference from the heading.")
        previous_weight: float = Field(2.0, ge=0, description="Cost of the difference from the direction before.")

    def _steer_by(self, target: Array, speed: Array, near: NearReturns) -> tuple[Array, Array, Array]:
        given, model, state = self.parameters, self._group.model, self._group.awareness.state
        pose, keep = believed_pose(self._group), self._surfaces.clearance
        way = target - pose.position
        ahead = np.arctan2(way[:, 1], way[:, 0])
        heading_weight = 0.0 if model.heading is None else given.heading_weight
        costs = DirectionCosts(given.target_weight, heading_weight, given.previous_weight)
        chosen, free = free_directions(ahead, self._memory, pose, near, keep, given.sectors, costs)
        towards = np.cos(near.angles - chosen[:, None])
        spare = np.maximum(near.distances - keep, 0.0)
        allowed = np.where(towards > _AHEAD, spare / (given.headway * np.maximum(towards, _AHEAD)), np.inf)
        speed = np.where(free, np.minimum(speed, allowed.min(axis=1, initial=np.inf)), 0.0)
        velocity = speed[:, None] * np.stack([np.cos(chosen), np.sin(chosen)], axis=1)
        return model.follow_velocity(state, velocity), velocity, chosen
