"""Violations in MuJoCo are explained as in any other world, by the belief of one agent of a group."""

from pathlib import Path

import pytest
import yaml

import symaware_cli as sa
from symaware_cli.evidence import explain

ROOT = Path(__file__).parents[3]


@pytest.mark.slow
def test_the_wrong_belief_of_one_agent_of_a_group_is_the_cause(tmp_path: Path) -> None:
    tree = yaml.safe_load((ROOT / "scenarios" / "mist.yaml").read_text(encoding="utf-8"))
    agents = tree["agents"]
    walkers = {**agents.pop("walker"), "count": 2}
    # The second one crosses the way of the cart long after it.
    walkers["state"] = [[0.0, -4.0], [-4.0, -6.0]]
    walkers["knowledge"] = {"goal": [[0.0, 4.0], [-4.0, 3.0]]}
    agents["walker"] = walkers
    del agents["runner"]
    tree["environment"]["use"] = "mujoco"
    # In this world, bodies do not pass through each other: they touch at 0.8 m.
    tree["specifications"] = {"apart": {"pairs": [["cart", "walker"]], "formula": "always distance > 0.85"}}
    (tmp_path / "mist.yaml").write_text(yaml.safe_dump(tree, sort_keys=False), encoding="utf-8")
    sa.load(tmp_path / "mist.yaml").run(output=tmp_path / "mist.mcap")
    found = explain(tmp_path / "mist.mcap", before=[1.0], within=0.5, futures=16)
    assert [each.candidate.text for each in found.causes] == ["walker.0 about cart"]
    assert {row.candidate.text for row in found.rows} >= {"walker.1 about cart", "walker.0 about walker.1"}
