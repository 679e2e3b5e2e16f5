"""The manifest of a log: who takes part in the run."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from symaware_cli.core import AgentGroup, Environment
from symaware_cli.recording.json_text import read_json
from symaware_cli.recording.log_schema import FORMAT


def read_manifest(content: bytes) -> dict[str, Any]:
    """Read a manifest.

    Args:
        content: The attachment of that name.

    Returns:
        What it says, each entry that this version knows of the type that it must have. One of a newer format is
        returned as it is.

    Raises:
        ValueError: It is damaged.
    """
    said = read_json(content)
    if not isinstance(said, dict) or type(said.get("format")) is not int:
        raise ValueError("a manifest without a format")
    if said["format"] <= FORMAT:
        # Imported for those who read: runs start without it.
        from symaware_cli.recording.manifest_schema import Manifest

        Manifest.model_validate_json(content)
    return said


def manifest(
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
) -> bytes:
    """Describe who takes part in a run, as the attachment of that name.

    Args:
        name: The scenario's name.
        seed: The seed in force.
        mode: ``synchronous`` or ``asynchronous``.
        steps: How many steps are to be made.
        environment: The world, initialised.
        groups: All groups.
        uses: For each group, the entry-point names of its ``model`` and ``components``.
        indexed: For each group, whether its agents are numbered.
        part: Of a run that is spread over several processes, which one this is: its ``name``, whether it is the
            ``host``, and the ``agents`` that it runs.
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
    if part is not None:
        content["part"] = dict(part)
    return json.dumps(content, indent=1).encode()


def _absent(group: AgentGroup) -> dict[str, list[str]]:
    """Who is not in the world at the beginning, of a group whose agents enter or leave."""
    present = group.present
    return {} if present is None else {"absent": [group.ids[row] for row in np.flatnonzero(~present).tolist()]}


def _entity(environment: Environment, name: str) -> dict[str, Any]:
    """Describe an obstacle, with the pose that it has at the beginning, and whether it ever leaves that."""
    pose, described = environment.pose(name), environment.obstacles[name].model_dump(mode="json")
    position = list(pose.position)
    return {**described, "position": position, "heading": pose.heading, "moves": environment.moves(name)}
