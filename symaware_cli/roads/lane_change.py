"""Lane changes: vehicles that follow others, or change to a lane in which they can drive faster.

Reasons: docs/decisions/0096-roads.md
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup
from symaware_cli.geometry import Array, Indices, Mask
from symaware_cli.roads.car_following import CarFollowing, LaneNeighbours, Others
from symaware_cli.roads.driver_model import idm_acceleration
from symaware_cli.roads.lane_keeping import Driving, LanePosition
from symaware_cli.world import SECOND


class LaneChoice(NamedTuple):
    """The decisions of a turn about lanes; shape (n,) each.

    Attributes:
        begins: Whether each agent begins to change lanes, or to return.
        origin: The lane that each agent leaves, and returns to if it has to; -1 for agents that do not change lanes.
        due: The time of the next decision of each agent [ns].
    """

    begins: Mask
    origin: Indices
    due: Array


class LaneChange(CarFollowing):
    """Follows others like `control.car-following`, and changes lanes to drive faster without hindering others.

    A lane to the left or right with the same direction is taken by MOBIL (A. Kesting, M. Treiber, D. Helbing, "General
    lane-changing model MOBIL for car-following models", Transportation Research Record 1999, 2007): if no other is
    beside, the new follower need not brake harder than ``safe_braking``, and the own acceleration grows by more than
    the ``threshold``, plus the ``politeness`` times the loss of the followers in both lanes. ``keep_right`` is added to
    that for changes to the right, and subtracted for those to the left. Accelerations follow the intelligent driver
    model, with the own parameters also for others.

    Decisions are taken every ``decide`` [s], by each agent at its own instants. During a change an agent follows others
    in both lanes, and returns if another gets beside its place in the new lane before half of the way is done.
    """

    events: ClassVar = {
        **CarFollowing.events,
        "lane-changed": "An agent begins to change to another lane, or to return; `lane` is its name.",
    }

    class Parameters(CarFollowing.Parameters):
        """When to change lanes."""

        politeness: float = Field(0.2, ge=0, le=1, description="Weight of the accelerations of others.")
        threshold: float = Field(0.1, ge=0, le=100, description="Acceleration that has to be gained [m/s^2].")
        safe_braking: float = Field(
            3.0,
            gt=0,
            le=100,
            description="Greatest deceleration that a change may force upon the new follower [m/s^2].",
        )
        keep_right: float = Field(
            0.0, ge=-100, le=100, description="Acceleration by which changes to the right are preferred [m/s^2]."
        )
        decide: float = Field(1.0, gt=0, le=1e4, description="Time between two decisions [s].")

    def initialise_component(self, group: AgentGroup) -> None:
        """Set the first decision of each agent to its own instant."""
        super().initialise_component(group)
        self._origin = np.full(len(group), -1)
        # Instants are drawn, so that neighbours seldom decide at the same time.
        self._due = self.now + self.random.uniform(1)[:, 0] * (self.parameters.decide * SECOND)

    def _compute(self) -> Driving:
        here, others, network = self._position(), self._others(), self._network
        ahead = self._neighbours(others, here, here.lane)
        now = self._accelerations(here, here.lane, ahead)
        width = network.width[here.lane]
        # A change lasts until a tenth of the lane's width is left.
        changing = here.has_begun & (self._origin >= 0) & (np.abs(here.across) > 0.1 * width)
        origin = np.where(changing, self._origin, -1)
        lane, acceleration = here.lane, now
        back = self._returning(here, others, origin, ahead, width)
        lane, origin = np.where(back, origin, lane), np.where(back, here.lane, origin)
        # No decision is made during a change.
        may = here.has_begun & (self.now >= self._due) & (origin < 0)
        begins = back
        if may.any():
            gain, chosen, there = self._best(here, others, ahead, now)
            changes = may & (gain > 0.0)
            begins = begins | changes
            lane, origin = np.where(changes, chosen, lane), np.where(changes, here.lane, origin)
            acceleration = np.where(changes, np.minimum(now, there), now)
        due = np.where(may, self.now + self.parameters.decide * SECOND, self._due)
        return self._driven(here, lane, acceleration, LaneChoice(begins, origin, due))

    def _update(self, value: Driving) -> None:
        super()._update(value)
        choice: LaneChoice = value.further
        present = self._group.in_world
        for row in np.flatnonzero(choice.begins & present).tolist():
            name = self._network.lanes[int(value.lane[row])].name
            self.emit_for(row, "lane-changed", f"begins to change to the lane {name}", lane=name)
        self._origin, self._due = choice.origin, choice.due

    def _returning(
        self, here: LanePosition, others: Others, origin: Indices, ahead: LaneNeighbours, width: Array
    ) -> Mask:
        """Return whether each agent has another beside its place in the new lane, but not in its previous one."""
        beside = (origin >= 0) & (np.abs(here.across) > 0.5 * width) & ((ahead.gap <= 0.0) | (ahead.gap_behind <= 0.0))
        if not beside.any():
            return beside
        before = self._neighbours(others, here, np.where(beside, origin, here.lane))
        return beside & (before.gap > 0.0) & (before.gap_behind > 0.0)

    def _best(
        self, here: LanePosition, others: Others, ahead: LaneNeighbours, now: Array
    ) -> tuple[Array, Indices, Array]:
        """Return the gain of the better change of each agent, its lane, and the acceleration there; (n,) each."""
        best, chosen, there = np.full(len(now), -np.inf), here.lane.copy(), now.copy()
        for beside, bias in ((self._network.right, 1.0), (self._network.left, -1.0)):
            target = beside[here.lane]
            has = target >= 0
            if not has.any():
                continue
            lane = np.where(has, target, here.lane)
            around = self._neighbours(others, here, lane)
            then = self._accelerations(here, lane, around)
            gain, harm = self._incentive(here, lane, ahead, around, now, then)
            is_safe = (around.gap > 0.0) & (around.gap_behind > 0.0) & (harm >= -self.parameters.safe_braking)
            is_safe &= then >= -self.parameters.safe_braking
            gain = gain + bias * self.parameters.keep_right - self.parameters.threshold
            better = has & is_safe & (gain > best)
            best, chosen = np.where(better, gain, best), np.where(better, lane, chosen)
            there = np.where(better, then, there)
        return best, chosen, there

    def _incentive(
        self,
        here: LanePosition,
        lane: Indices,
        ahead: LaneNeighbours,
        around: LaneNeighbours,
        now: Array,
        then: Array,
    ) -> tuple[Array, Array]:
        """Return the incentive of a change by MOBIL, and the acceleration of the new follower [m/s^2]."""
        front, rear, _ = self._shape
        own = front + rear
        desired = self._desired_here(lane)

        def following(speed: Array, gap: Array, leading: Array) -> Array:
            # An other's desired speed is at least its present speed, as far as is known.
            return idm_acceleration(speed, np.maximum(desired, speed), gap, leading, self._driver)

        new = following(around.speed_behind, around.gap_behind, here.speed)
        new_before = following(around.speed_behind, around.gap_behind + own + around.gap, around.speed)
        old = following(ahead.speed_behind, ahead.gap_behind + own + ahead.gap, ahead.speed)
        old_before = following(ahead.speed_behind, ahead.gap_behind, here.speed)
        harm = np.where(np.isinf(around.gap_behind), 0.0, new)
        of_new = np.where(np.isinf(around.gap_behind), 0.0, new - new_before)
        of_old = np.where(np.isinf(ahead.gap_behind), 0.0, old - old_before)
        return then - now + self.parameters.politeness * (of_new + of_old), harm
