"""An agent that never enters is nobody's neighbour, with a network and without."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

TELLERS: dict[str, Any] = {
    "communication.gossip": {"name": "value", "fanout": 1},
    "communication.consensus": {"name": "value", "weights": "metropolis"},
    "communication.state": {},
}


def known(folder: Path, use: str, topology: Any, absent: bool) -> Any:
    """What each agent knows, and how often it was told something, after a run."""
    robots = {
        "count": 5,
        "model": {"use": "single-integrator"},
        "state": {"circle": {"radius": 3}},
        "knowledge": {"value": {"each": [1.0, 2.0, 3.0, 4.0, 5.0]}},
        "components": {"tell": {"use": use, "with": TELLERS[use]}},
    }
    # One before and one after the others in the roster.
    others = {"present": {"from": 1e6}, "model": {"use": "single-integrator"}, "state": [0, 0]}
    agents = {"robot": robots, **({"a": others, "z": others} if absent else {})}
    scenario: dict[str, Any] = {
        "symaware": 1,
        "name": "told",
        "seed": 3,
        "run": {"duration": 0.6},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "agents": agents,
    }
    if topology is not None:
        scenario["topology"] = topology
    (folder / "s.yaml").write_text(yaml.safe_dump(scenario))
    built = build(folder / "s.yaml")
    group = next(group for group in built.simulation.groups if group.name == "robot")
    heard: list[tuple[int, str, str]] = []
    built.simulation.events.subscribe(
        "received", lambda event: heard.append((event.time, event.value.sender, event.value.receiver))
    )
    execute(built, folder / f"{absent}.mcap")
    return [each["value"] for each in group.knowledge], heard


@pytest.mark.parametrize("use", TELLERS)
@pytest.mark.parametrize("topology", [None, {"use": "complete"}])
def test_an_agent_that_never_enters_changes_nothing_that_others_hear(use: str, topology: Any, tmp_path: Path) -> None:
    values, heard = known(tmp_path, use, topology, absent=False)
    again, heard_again = known(tmp_path, use, topology, absent=True)
    np.testing.assert_array_equal(values, again)
    assert heard == heard_again
    assert heard
