"""How drivers accelerate and change lanes: the intelligent driver model, and MOBIL.

Sources: M. Treiber, A. Hennecke, D. Helbing, "Congested traffic states in empirical observations and microscopic
simulations", Physical Review E 62, 2000; A. Kesting, M. Treiber, D. Helbing, "General lane-changing model MOBIL for
car-following models", Transportation Research Record 1999, 2007.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from symaware_cli.geometry import Array

#: The least gap in computations [m]: bodies that touch brake as hard as they can.
_LEAST_GAP = 0.1


class Driver(NamedTuple):
    """The parameters of the intelligent driver model.

    Attributes:
        standstill: The gap to a standing car ahead, s0 [m].
        headway: The time gap T [s].
        acceleration: The greatest acceleration a [m/s^2].
        braking: The comfortable deceleration b [m/s^2].
        hardest: The greatest deceleration of the brakes [m/s^2].
    """

    standstill: float
    headway: float
    acceleration: float
    braking: float
    hardest: float


def idm_acceleration(speed: Array, desired: Array, gap: Array, leading: Array, driver: Driver) -> Array:
    """Return accelerations a (1 - (v / v0)^4 - (s* / s)^2) with s* = s0 + max(0, v T + v (v - v1) / (2 sqrt(a b))).

    Args:
        speed: The speeds v [m/s].
        desired: The speeds v0 on a free road [m/s]; 0 for an agent that wants to stand.
        gap: The gaps s to the body ahead [m]; infinite if there is none.
        leading: The speeds v1 of the bodies ahead along the lane [m/s].
        driver: The parameters.

    Returns:
        Accelerations, at least minus the hardest braking [m/s^2].
    """
    ratio = speed / np.maximum(desired, 1e-3)
    square = np.minimum(ratio * ratio, 1e3)
    approach = speed * (speed - leading) / (2.0 * np.sqrt(driver.acceleration * driver.braking))
    wanted = driver.standstill + np.maximum(0.0, speed * driver.headway + approach)
    interaction = wanted / np.maximum(gap, _LEAST_GAP)
    acceleration: Array = driver.acceleration * (1.0 - square * square - interaction * interaction)
    return np.maximum(acceleration, -driver.hardest)


def equilibrium_gap(speed: float, desired: float, driver: Driver) -> float:
    """Return the gap behind a car of constant speed, (s0 + v T) / sqrt(1 - (v / v0)^4) [m].

    Args:
        speed: The speed v of both cars [m/s], less than the desired one.
        desired: The speed on a free road [m/s].
        driver: The parameters.
    """
    ratio = speed / desired
    return float((driver.standstill + speed * driver.headway) / np.sqrt(1.0 - ratio**4))
