"""Elasticity in MuJoCo: a spring with a damper as long as bodies overlap."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

from symaware_cli.core import ScenarioView
from symaware_cli.worlds import GroundPlane

#: The phase of the spring's oscillation per physics step [rad]: smaller values make contacts softer, and their
#: elasticity more exact.
PHASE = 0.25

#: The same for inelastic contacts, for which a softer spring leaves less speed.
DEAD_PHASE = 0.2

#: The relative deviation of the speed after a collision from that by the elasticity, above which users are warned.
TOLERANCE = 0.05

#: The points within a step at which collisions are assumed to begin.
_PHASES = 8

#: The part of the motion at a contact that the constraint determines; forces determine the rest.
IMPEDANCE = 0.99


def solref(elasticity: float, step: float) -> tuple[float, float]:
    """Return MuJoCo's reference of a contact as negative stiffness [1/s^2] and damping [1/s].

    Args:
        elasticity: The part of the speed that remains after a collision, from 0 to 1.
        step: The physics step [s].
    """
    if elasticity == 0.0:
        frequency = DEAD_PHASE / step
        return -frequency * frequency, -1.0 / step
    frequency = PHASE / step
    return -frequency * frequency, -2.0 * damping_ratio(elasticity) * frequency


@cache
def damping_ratio(elasticity: float) -> float:
    """Return the damping ratio with which bodies keep a part of their speed, found by bisection.

    At a ratio of 2, the speed is 0 after one step.
    """
    low, high = 0.0, 2.0
    if elasticity >= 1.0:
        return low
    for _ in range(50):
        ratio = 0.5 * (low + high)
        low, high = (ratio, high) if rebound(ratio) > elasticity else (low, ratio)
    return high


def rebound(ratio: float) -> float:
    """Return the part of the speed that remains after a contact, with the engine's integrator.

    This is the mean over points within a step at which the contact begins. The engine changes velocities by the
    constraint, which only pushes, and then moves bodies by the new velocities (semi-implicit Euler).
    """
    return sum(_rebounds(PHASE, ratio)) / _PHASES


@cache
def rebound_range(elasticity: float) -> tuple[float, float]:
    """Return the least and greatest part of the speed that remains, over points of a step at which contact begins."""
    stiffness, damping = solref(elasticity, 1.0)
    phase = (-stiffness) ** 0.5
    found = list(_rebounds(phase, -damping / (2.0 * phase)))
    return min(found), max(found)


def _rebounds(phase: float, ratio: float) -> Iterator[float]:
    for number in range(_PHASES):
        # In units of a step: the distance from contact, and the velocity per step.
        distance, velocity = -(number + 0.5) / _PHASES, -1.0
        while distance < 0.0 or velocity < 0.0:
            push = -phase * phase * distance - 2.0 * ratio * phase * velocity if distance < 0.0 else 0.0
            # The constraint is solved for the velocity after the step.
            velocity += IMPEDANCE * max(push, 0.0)
            distance += velocity
            if distance < 0.0 and 0.0 <= velocity < 1e-6:
                break
        yield max(velocity, 0.0)


class _Bouncing(NamedTuple):
    """A body, or all bodies of a group, with its place in the scenario, its elasticity, and its possible partners."""

    section: tuple[str, ...]
    elasticity: float
    moves: bool
    meets_ground: bool


def warn_of_bounces(view: ScenarioView, ground: GroundPlane | None) -> None:
    """Warn of elasticities for which the speed after collisions deviates by more than 5 %.

    There is one warning for each product of two elasticities, at the body with the smaller elasticity. Inelastic bodies
    are left out.

    Args:
        view: The scenario, which receives the warnings.
        ground: The ground, if there is one.
    """
    bodies = _bodies(view)
    told: set[float] = set()
    for body in bodies:
        others = [each.elasticity for each in bodies if each is not body and (each.moves or body.moves)]
        if ground is not None and body.meets_ground:
            others.append(ground.elasticity)
        for elasticity in sorted({body.elasticity * other for other in others if other >= body.elasticity} - told):
            low, high = rebound_range(elasticity)
            if elasticity and max(elasticity - low, high - elasticity) > TOLERANCE * elasticity:
                told.add(elasticity)
                said = (
                    f"a collision of this elasticity, {elasticity:g} with that of the other body, leaves {low:.2f} to "
                    f"{high:.2f} of the speed in this world, depending on where in a physics step it begins"
                )
                view.warn(said, "elasticity", section=body.section, code="inexact-elasticity")


def _bodies(view: ScenarioView) -> Sequence[_Bouncing]:
    found = [
        _Bouncing(("agents", group.name, "entity"), group.entity.elasticity, True, len(group.model.position) == 3)
        for group in view.groups
        if group.entity.shape is not None
    ]
    return found + [
        _Bouncing(
            ("environment", "entities", name), each.elasticity, each.is_free or each.path is not None, each.is_free
        )
        for name, each in view.document.environment.entities.items()
    ]
