"""Joints of robots from files: their motions, and their limits of position, velocity and effort."""

from __future__ import annotations

from dataclasses import dataclass, field

from symaware_cli.assets.xml_tree import XmlElement


@dataclass(frozen=True)
class RobotJoint:
    """A joint that turns or slides.

    Attributes:
        name: The name of the joint.
        turns: Whether the joint turns; else it slides.
        lower: The least position [rad] or [m]; like the following limits, infinite if there is none.
        upper: The greatest position [rad] or [m].
        effort: The greatest torque [N m] or force [N] of its motor.
        velocity: The greatest velocity [rad/s] or [m/s].
        element: The element of the file that describes the joint.
    """

    name: str
    turns: bool
    lower: float
    upper: float
    effort: float
    velocity: float
    element: XmlElement = field(compare=False, repr=False)
