"""Vector field histograms: drives in the free direction of a scan that costs least.

Reasons: docs/decisions/0087-sensing.md
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from symaware_cli.engine.components.control.free_direction import DirectionCosts, free_directions
from symaware_cli.engine.components.control.scan_steering import ScanSteering
from symaware_cli.engine.components.scan_surfaces import NearReturns, believed_pose
from symaware_cli.geometry import Array

#: Surfaces at right angles to the motion, and behind it, do not limit the speed.
_AHEAD = 1e-6

#: Speeds below this are 0 [m/s].
_LEAST = 1e-12


class VectorFieldHistogram(ScanSteering):
    """Drives to a goal, or along waypoints, by the returns of a lidar.

    Each return within `range` blocks the directions in which a disc around the body, widened by the margin, would touch
    it. Of the free ones the agent takes that with the least cost: the weighted differences from the direction of the
    target, from the heading, and from the direction chosen before (VFH+: I. Ulrich, J. Borenstein, "VFH+: reliable
    obstacle avoidance for fast mobile robots", ICRA 1998; directions are blocked by single returns here, not by the
    density of a grid). Differences to the left count a tenth more, so that two that meet pass each other on the right.

    The speed is such that the distance to each surface, along the straight line to it, would take at least `headway`
    to use up. So an agent stops in front of what does not give way, and two of them if the headway is at least twice
    the time between two scans. The speed keeps only a share of the margin, `speed_margin`: with all of it an agent that
    passes something along a tangent would creep.

    If all directions are blocked, only what is close to the body blocks them (`last_resort`), so that an agent leaves a
    place that is surrounded at a distance. If they are blocked even so, it stands still.

    A body with a heading moves along it while it turns towards the direction that was chosen. So the surfaces ahead of
    the heading limit its speed as well: close to something, it turns first and then drives on.

    The model follows the velocity as well as it can; `margin` has to cover the difference.
    """

    class Parameters(ScanSteering.Parameters):
        """Directions and their costs."""

        sectors: int = Field(72, ge=8, le=720, description="How many directions are compared.")
        headway: float = Field(0.6, gt=0, description="In what time a distance may at most be used up [s].")
        speed_margin: float = Field(
            0.5, ge=0, le=1, description="The share of `margin` that the speed keeps; directions keep all of it."
        )
        last_resort: Annotated[float, Field(ge=0)] | None = Field(
            0.3,
            description="If no direction is free, only what is within this distance of the body with its margin blocks "
            "directions [m]; null if the agent stands still instead.",
        )
        limit_by_heading: bool = Field(
            True,
            description="Whether what is ahead of the present heading limits the speed, and not only what is ahead of "
            "the chosen direction. Models without a heading move in the chosen direction.",
        )
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
        if given.last_resort is not None and not free.all():
            close = near.distances <= keep + given.last_resort
            around = NearReturns(near.angles, np.where(close, near.distances, np.inf))
            again = free_directions(ahead, self._memory, pose, around, keep, given.sectors, costs)
            chosen, free = np.where(free, chosen, again.angles), free | again.free
        speed = np.where(free, np.minimum(speed, self._fastest(chosen, near)), 0.0)
        control_input = model.follow_velocity(state, _along(chosen, speed))
        if given.limit_by_heading and model.heading is not None:
            # Slowed down afterwards, because without a speed there would be no direction to turn to.
            factor = np.minimum(self._fastest(pose.heading, near) / np.maximum(speed, _LEAST), 1.0)
            control_input, speed = model.slowed(state, control_input, factor), factor * speed
        return control_input, _along(chosen, speed), chosen

    def _fastest(self, directions: Array, near: NearReturns) -> Array:
        """Return the greatest speeds in directions (n,) [rad] that the distances allow [m/s]; shape (n,)."""
        given = self.parameters
        towards = np.cos(near.angles - directions[:, None])
        keep = self._surfaces.clearance - (1.0 - given.speed_margin) * given.margin
        spare = np.maximum(near.distances - keep, 0.0)
        allowed = np.where(towards > _AHEAD, spare / (given.headway * np.maximum(towards, _AHEAD)), np.inf)
        fastest: Array = allowed.min(axis=1, initial=np.inf)
        return fastest


def _along(directions: Array, speeds: Array) -> Array:
    """Return velocities with directions (n,) [rad] and speeds (n,); shape (n, 2)."""
    velocities: Array = speeds[:, None] * np.stack([np.cos(directions), np.sin(directions)], axis=1)
    return velocities
