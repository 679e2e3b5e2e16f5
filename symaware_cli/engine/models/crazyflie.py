"""The Crazyflie 2.x: physical parameters, rotors, drag, ground effect and downwash.

Sources: [F] J. Foerster, System Identification of the Crazyflie 2.0 Nano Quadrocopter, ETH Zurich, 2015;
[L] C. Luis and J. Le Ny, Design of a Trajectory Tracking Controller for a Nanoquadcopter, Polytechnique Montreal, 2016
(arXiv:1608.05786); [P] J. Panerati et al., Learning to Fly, IROS 2021.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from symaware_cli.engine.models.vector import Axes, Vector, dot
from symaware_cli.geometry import Array
from symaware_cli.world import columns

#: [kg] The mass with the battery [L].
MASS = 0.027
#: [kg m^2] about the x, y and z axes; products of inertia, under a tenth of these, are left out [F].
INERTIA = (16.6e-6, 16.6e-6, 29.3e-6)
#: [m] The distance from the centre to a rotor [F], and its component along either axis.
ARM = 0.046
REACH = ARM / math.sqrt(2.0)
#: [m] The radius of a propeller [L].
PROPELLER = 0.0231348
_RADIANS = (60.0 / (2.0 * math.pi)) ** 2
#: [N s^2] and [N m s^2]: thrust and reaction torque of a rotor over its squared speed [L], converted from rpm.
THRUST, REACTION = 3.1582e-10 * _RADIANS, 7.9379e-12 * _RADIANS
#: [kg] Drag over the velocity and the sum of rotor speeds, along the axes of the body [F].
DRAG = (9.1785e-7, 9.1785e-7, 10.311e-7)
#: The ratio of the maximum thrust to the weight [P].
THRUST_TO_WEIGHT = 2.25
#: The position of each rotor in units of REACH, and the sign of its reaction torque: the first is at the front right,
#: the others follow clockwise as seen from above; the first and the third turn counter-clockwise.
ROTORS = ((1, -1, -1), (-1, -1, 1), (-1, 1, -1), (1, 1, 1))
#: Downwash: strength, and growth [1/m] and offset of its width with the distance [P].
_DOWNWASH = (2267.18, 0.16, -0.11)


def rotor_wrench(speeds: Any) -> tuple[Any, Vector]:
    """Return the thrust of all rotors [N], and their torque about the axes of the body [N m]."""
    squares = [speeds[number] * speeds[number] for number in range(4)]
    thrust = THRUST * (squares[0] + squares[1] + squares[2] + squares[3])
    torque = tuple(
        sum(sign * square for sign, square in zip(signs, squares, strict=True)) * arm
        for signs, arm in (
            ([rotor[1] for rotor in ROTORS], THRUST * REACH),
            ([-rotor[0] for rotor in ROTORS], THRUST * REACH),
            ([rotor[2] for rotor in ROTORS], REACTION),
        )
    )
    return thrust, (torque[0], torque[1], torque[2])


def drag(axes: Axes, velocity: Vector, speeds: Any) -> Vector:
    """Return the drag along the axes of the body [N]."""
    turning = speeds[0] + speeds[1] + speeds[2] + speeds[3]
    along = [-coefficient * turning * dot(axis, velocity) for coefficient, axis in zip(DRAG, axes, strict=True)]
    return along[0], along[1], along[2]


def rotor_speeds(thrust: Any, torque: Sequence[Any], top: float) -> list[Any]:
    """Return the rotor speeds for a thrust and a torque.

    If the rotors cannot produce all, roll and pitch take precedence over thrust, and both over yaw.
    """
    roll, pitch, yaw = (
        0.25 * torque[0] / (THRUST * REACH),
        0.25 * torque[1] / (THRUST * REACH),
        0.25 * torque[2] / REACTION,
    )
    most = top * top
    tilting = [rotor[1] * roll - rotor[0] * pitch for rotor in ROTORS]
    widest = np.abs(tilting[0])
    for each in tilting[1:]:
        widest = np.maximum(widest, np.abs(each))
    share = np.minimum(1.0, 0.5 * most / np.maximum(widest, 1e-9))
    widest = widest * share
    common = np.minimum(np.maximum(0.25 * thrust / THRUST, widest), most - widest)
    room = np.minimum(common - widest, most - common - widest)
    yaw = np.minimum(np.maximum(yaw, -room), room)
    return [
        np.sqrt(np.maximum(common + share * tilt + rotor[2] * yaw, 0.0))
        for tilt, rotor in zip(tilting, ROTORS, strict=True)
    ]


def ground_effect(height: Array) -> Array:
    """Return the factor of the thrust near the ground: 1 / (1 - (R / 4 z)^2), down to a height of R / 2.

    Source: I. C. Cheeseman and W. E. Bennett, The Effect of the Ground on a Helicopter Rotor in Forward Flight, 1955.

    Args:
        height: Height above ground [m]; shape (n,).
    """
    share = PROPELLER / (4.0 * np.maximum(height, 0.5 * PROPELLER))
    return 1.0 / (1.0 - share * share)


def downwash(positions: Array) -> Array:
    """Return the downward force on each by those above it [N]; (n, 3) to (n,) [P]."""
    x, y, z = columns(positions)
    above = z[None, :] - z[:, None]
    below = above > 1e-3
    height = np.where(below, above, 1.0)
    strength = _DOWNWASH[0] * (PROPELLER / (4.0 * height)) ** 2
    width = _DOWNWASH[1] * height + _DOWNWASH[2]
    apart = (x[None, :] - x[:, None]) ** 2 + (y[None, :] - y[:, None]) ** 2
    pushed = strength * np.exp(-0.5 * apart / np.maximum(width * width, 1e-6))
    # Added up pair by pair, so that the result does not depend on the size of the array.
    total = np.zeros(len(z))
    for other in range(len(z)):
        total += np.where(below[:, other] & (apart[:, other] < 100.0), pushed[:, other], 0.0)
    return total
