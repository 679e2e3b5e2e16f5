"""The free direction of a scan that costs least, as of VFH+."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from symaware_cli.engine.components.scan_surfaces import BelievedPose, NearReturns
from symaware_cli.geometry import Array, Mask, wrapped

#: What turning off to the left costs more than to the right, so that those that meet do not choose the same side.
_LEFT = 1.1


class DirectionCosts(NamedTuple):
    """What differences of directions cost; those that Ulrich and Borenstein recommend, by default.

    Attributes:
        target: The difference from the direction of the target.
        heading: That from the heading.
        previous: That from the direction chosen before.
    """

    target: float = 5.0
    heading: float = 2.0
    previous: float = 2.0


class FreeDirections(NamedTuple):
    """The directions in which agents can go.

    Attributes:
        angles: The direction of each agent, that of the target if all are blocked [rad]; shape (n,).
        free: Whether it is free; shape (n,).
    """

    angles: Array
    free: Mask


def free_directions(
    ahead: Array,
    previous: Array,
    pose: BelievedPose,
    near: NearReturns,
    keep: float,
    sectors: int,
    costs: DirectionCosts,
) -> FreeDirections:
    """Choose the direction of each agent: the free one with the least cost.

    Each return blocks the directions in which a disc of radius `keep` would touch it (I. Ulrich, J. Borenstein, "VFH+:
    reliable obstacle avoidance for fast mobile robots", ICRA 1998, equation 5).

    Args:
        ahead: The direction of the target [rad]; shape (n,).
        previous: The direction chosen before [rad], NaN for none; shape (n,).
        pose: The poses of the agents.
        near: The returns of their lidars.
        keep: The distance to keep from these [m].
        sectors: How many directions are compared, besides that of the target.
        costs: The costs.
    """
    rows = np.arange(len(ahead))
    around = np.broadcast_to(2.0 * np.pi * np.arange(sectors) / sectors, (len(ahead), sectors))
    candidates = np.concatenate([ahead[:, None], around], axis=1)
    off = wrapped(candidates - ahead[:, None])
    cost = costs.target * np.where(off > 0.0, _LEFT, 1.0) * np.abs(off)
    cost = cost + costs.previous * np.abs(wrapped(candidates - np.where(np.isnan(previous), ahead, previous)[:, None]))
    cost = cost + costs.heading * np.abs(wrapped(candidates - pose.heading[:, None]))
    cost = np.where(_blocked(candidates, near, keep), np.inf, cost)
    best = cost.argmin(axis=1)
    free = np.isfinite(cost[rows, best])
    return FreeDirections(np.where(free, candidates[rows, best], ahead), free)


def _blocked(candidates: Array, near: NearReturns, keep: float) -> Mask:
    """Return which directions (n, c) lead too near to a return; shape (n, c)."""
    half = np.arcsin(np.minimum(keep / np.maximum(near.distances, keep), 1.0))
    blocked = np.zeros(candidates.shape, bool)
    # Agent by agent, as most see few returns within the range.
    for row in range(len(candidates)):
        some = np.flatnonzero(np.isfinite(near.distances[row]))
        apart = np.abs(wrapped(candidates[row, :, None] - near.angles[row, some]))
        # A body that is as near as it may be can move along the surface.
        blocked[row] = (apart < half[row, some] - 1e-9).any(axis=1)
    return blocked
