"""The manifest of a log: scenario, agents, groups and entities of the run."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from symaware_cli.log.json_text import read_json
from symaware_cli.log.log_schema import FORMAT

if TYPE_CHECKING:
    from symaware_cli.core import AgentGroup, Environment


def read_manifest(content: bytes) -> dict[str, Any]:
    """Read a manifest.

    Args:
        content: The attachment.

    Returns:
        Its content; all entries that this version knows have been validated. A manifest of a newer format is returned
        unchecked.

    Raises:
        ValueError: It is damaged.
    """
    said = read_json(content)
    if not isinstance(said, dict) or type(said.get("format")) is not int:
        raise ValueError("a manifest without a format")
    if said["format"] <= FORMAT:
        # Imported here because only readers need it; writing a log does without.
        from symaware_cli.log.manifest_schema import Manifest

        Manifest.model_validate_json(content)
    return said


def manifest_of(
    *,
    name: str,
    seed: int,
    mode: str,
    steps: int,
    environment: Environment,
    groups: Sequence[AgentGroup],
    uses: Mapping[str, Mapping[str, Any]],
    indexed: Mapping[str, bool],
    part: Mapping[str, Any] | None = None,
    tolerances: Mapping[str, float] | None = None,
) -> bytes:
    """Create the manifest of a run.

    Args:
        name: The scenario's name.
        seed: The random seed in force.
        mode: ``synchronous`` or ``asynchronous``.
        steps: Number of steps planned.
        environment: The initialised world.
        groups: All groups.
        uses: For each group, the entry-point names of its ``model`` and ``components``.
        indexed: For each group, whether its agents are numbered.
        part: For a run in several processes, the part of this process: its ``name``, whether it is the ``host``, and
            the ``agents`` that it runs.
        tolerances: See `Simulation.tolerances`.
    """
    content: dict[str, Any] = {
        "format": FORMAT,
        "name": name,
        "seed": seed,
        "mode": mode,
        "time_step": environment.time_step,
        "steps": steps,
        "groups": {
            group.name: {
                "agents": list(group.ids),
                "indexed": indexed[group.name],
                "model": {
                    "use": uses[group.name]["model"],
                    "state": [list(quantity) for quantity in group.model.state],
                    "control_input": [list(quantity) for quantity in group.model.control_input],
                    "position": list(group.model.position),
                    "heading": group.model.heading,
                },
                "entity": group.entity.model_dump(mode="json"),
                "components": uses[group.name]["components"],
                **_absent(group),
            }
            for group in sorted(groups, key=lambda group: group.name)
        },
        "entities": {name: _entity(environment, name) for name in environment.obstacles},
        "roster": [*environment.roster.ids, *environment.obstacles],
    }
    regions = groups[0].regions if groups else {}
    if regions:
        content["regions"] = {name: region.model_dump(mode="json") for name, region in regions.items()}
    if tolerances:
        content["repeatable_to"] = dict(tolerances)
    if part is not None:
        content["part"] = dict(part)
    return json.dumps(content, indent=1).encode()


def _absent(group: AgentGroup) -> dict[str, list[str]]:
    """Return the agents that are absent at the beginning, for a group whose agents enter or leave."""
    present = group.present
    return {} if present is None else {"absent": [group.ids[row] for row in np.flatnonzero(~present).tolist()]}


def _entity(environment: Environment, name: str) -> dict[str, Any]:
    """Describe an obstacle, with its initial pose and whether it moves."""
    pose, described = environment.pose(name), environment.obstacles[name].model_dump(mode="json")
    position = list(pose.position)
    return {**described, "position": position, "heading": pose.heading, "moves": environment.moves(name)}
