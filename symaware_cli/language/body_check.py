"""Warns of agents without a body in a world with objects to collide with."""

from __future__ import annotations

from collections.abc import Sequence

from symaware_cli.core import AgentGroup
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.document import ScenarioDocument
from symaware_cli.language.problem import quoted


def check_bodies(document: ScenarioDocument, groups: Sequence[AgentGroup], diagnosis: Diagnosis) -> None:
    """Warn of each group whose agents pass through others without a contact, unless the scenario declares this.

    Args:
        document: The validated document.
        groups: All groups.
        diagnosis: Takes warnings.
    """
    # The groups of vehicles have the shapes of their models.
    bodies = {group.name for group in groups if group.entity.shape is not None}
    for group in groups:
        if group.name in bodies or "shape" in document.agents[group.name].entity.model_fields_set:
            continue
        others = [*document.environment.entities, *sorted(bodies)]
        if others:
            named = ", ".join(map(quoted, others[:3])) + (" and others" if len(others) > 3 else "")
            diagnosis.warn(
                "no-body",
                f"{quoted(group.name)} has no body, so it passes through {named} without a contact",
                ("agents", group.name),
                key=True,
                expected="an `entity` with a `shape`, or `entity: {shape: null}` for a point",
            )
