"""An agent that never enters the world changes nothing for those who perceive everybody."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from checkout import CHECKOUT

import symaware_cli as sa

#: Scenarios in which agents perceive everybody, whose topology does not depend on how many they are.
SCENARIOS = [
    path
    for path in sorted((CHECKOUT / "scenarios").glob("*.yaml"))
    if {"perception.omniscient"} <= set(path.read_text().replace(",", " ").replace("}", " ").split())
    and "topology" not in path.read_text()
    and not path.name.startswith("_")
]


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda path: path.name)
def test_an_agent_that_never_enters_changes_nothing(scenario: Path, tmp_path: Path) -> None:
    short = {"run.duration": 2.0, "recording.interval": 0.0, "recording.omit": []}
    absent = {"agents.zz": {"model": {"use": "single-integrator"}, "state": [1.0, 1.0], "present": {"from": 1e6}}}
    one = sa.load(scenario, short).run(output=tmp_path / "one.mcap").log
    other = sa.load(scenario, short | absent).run(output=tmp_path / "other.mcap").log
    for group in one.agents:
        for field in ("world", "state", "requested_control"):
            before, after = one.series(group, field), other.series(group, field)
            assert before.times.tolist() == after.times.tolist()
            assert np.array_equal(before.values, after.values, equal_nan=True)


def test_an_agent_that_never_enters_hides_no_blocked_cell(tmp_path: Path) -> None:
    """Rays that end at others tell of no cell; nobody knows where one is who is absent."""
    scenario = yaml.safe_load((CHECKOUT / "scenarios" / "blocked.yaml").read_text())
    scenario["agents"]["scout"]["components"]["sense"] = {"use": "perception.omniscient"}
    scenario["run"]["duration"] = 30.0
    learnt = []
    for absent in (False, True):
        if absent:
            scenario["agents"]["zz"] = {"model": {"use": "single-integrator"}, "present": {"from": 1e6}}
        path = tmp_path / f"{absent}.yaml"
        path.write_text(yaml.safe_dump(scenario))
        log = sa.load(path).run(output=tmp_path / f"{absent}.mcap").log
        learnt.append([(each.time, str(each)) for each in log.knowledge("scout")])
    assert len(learnt[0]) > 1
    assert learnt[0] == learnt[1]
