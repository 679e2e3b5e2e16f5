"""Joints of robots from files: which way they move, and how far, how fast and how strongly."""

from __future__ import annotations

from dataclasses import dataclass, field

from symaware_cli.assets.xml_tree import XmlElement


@dataclass(frozen=True)
class RobotJoint:
    """A joint that turns or slides.

    Attributes:
        name: Its name.
        turns: Whether it turns; else it slides.
        lower: Its least position [rad] or [m]; infinite without a limit, as the following are.
        upper: Its greatest position [rad] or [m].
        effort: The greatest torque [N m] or force [N] of its motor.
        velocity: Its greatest velocity [rad/s] or [m/s].
        element: Where it is in the file.
    """

    name: str
    turns: bool
    lower: float
    upper: float
    effort: float
    velocity: float
    element: XmlElement = field(compare=False, repr=False)
