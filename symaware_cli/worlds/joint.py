"""Joints of the planar world: pins, slides, pivots, springs and motors between bodies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import pymunk
from pydantic import Field, model_validator

from symaware_cli.core import ErrorCollector, Parameters, WorldError

_Coordinate = Annotated[float, Field(ge=-1e9, le=1e9)]
_Point = tuple[_Coordinate, _Coordinate]


class Joint(Parameters):
    """A joint between two bodies, or between a body and the world."""

    kind: Literal["pin", "slide", "pivot", "spring", "motor"] = Field(
        description="pin: a rod that keeps two anchors as far apart as they are; slide: a rope that keeps them no "
        "farther apart than `length`; pivot: a hinge in which the anchors meet; spring: one of a `length`, a "
        "`stiffness` and a `damping`; motor: turns the first against the second at a `rate`."
    )
    between: tuple[str, str | None] = Field(
        description="Two bodies by name: agents, or entities; null in place of the second for the world itself."
    )
    anchors: tuple[_Point, _Point] = Field(
        ((0.0, 0.0), (0.0, 0.0)),
        description="Where it is fixed to each, in the coordinates of the body; in those of the world for null [m].",
    )
    length: float | None = Field(None, ge=0, le=1e9, description="The length of a rope, or of a spring at rest [m].")
    stiffness: float | None = Field(None, gt=0, le=1e12, description="The force of a spring for each metre [N/m].")
    damping: float = Field(0.0, ge=0, le=1e12, description="The force of a spring for each m/s [N s/m].")
    rate: float | None = Field(None, ge=-1e6, le=1e6, description="The turn rate of a motor [rad/s].")
    max_force: float | None = Field(
        None, gt=0, description="Greatest force [N], of a motor torque [N m]; no limit if null."
    )
    collide: bool = Field(False, description="Whether the two bodies touch each other, too.")

    @model_validator(mode="after")
    def _has_what_it_needs(self) -> Joint:
        needed = {"slide": ("length",), "spring": ("length", "stiffness"), "motor": ("rate",)}.get(self.kind, ())
        for name in needed:
            if getattr(self, name) is None:
                raise ValueError(f"a {self.kind} needs a `{name}`")
        for name in ("length", "stiffness", "rate"):
            if getattr(self, name) is not None and name not in needed:
                raise ValueError(f"a {self.kind} has no `{name}`")
        if self.between[0] == self.between[1]:
            raise ValueError("a joint is between two different bodies")
        return self


def make_joints(joints: Mapping[str, Joint], bodies: Mapping[str, pymunk.Body], world: pymunk.Body) -> list[Any]:
    """Create the engine's constraints.

    Args:
        joints: The joints by name.
        bodies: All bodies by name.
        world: The static body.

    Raises:
        WorldError: A body does not exist, or neither of two can move.
    """
    made, errors = [], ErrorCollector()
    for name, joint in sorted(joints.items()):
        where = ("environment", "with", "joints", name)
        with errors.catch():
            missing = [each for each in joint.between if each is not None and each not in bodies]
            if missing:
                message = f"the joint `{name}` refers to `{missing[0]}`, which is no agent and no entity"
                raise WorldError(message, *where, "between")
            one, other = (world if each is None else bodies[each] for each in joint.between)
            if pymunk.Body.DYNAMIC not in (one.body_type, other.body_type):
                raise WorldError(f"the joint `{name}` is between two immovable bodies: give one a mass", *where)
            constraint = _create_constraint(joint, one, other)
            if joint.max_force is not None:
                constraint.max_force = joint.max_force
            constraint.collide_bodies = joint.collide
            made.append(constraint)
    errors.raise_first()
    return made


def _create_constraint(joint: Joint, one: pymunk.Body, other: pymunk.Body) -> Any:
    anchors = joint.anchors
    match joint.kind:
        case "pin":
            return pymunk.PinJoint(one, other, *anchors)
        case "slide":
            return pymunk.SlideJoint(one, other, *anchors, 0.0, joint.length or 0.0)
        case "pivot":
            return pymunk.PivotJoint(one, other, *anchors)
        case "spring":
            return pymunk.DampedSpring(one, other, *anchors, joint.length or 0.0, joint.stiffness or 0.0, joint.damping)
        case _:
            return pymunk.SimpleMotor(one, other, joint.rate or 0.0)
