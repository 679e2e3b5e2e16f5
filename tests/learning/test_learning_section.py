from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from learning_scenarios import HEAD_ON

import symaware_cli as sa

SECTION = """
learning:
  agents: robot
  observation:
  - state
  - goal - position
  - {nearest: 2}
  action: {high: 1.2}
  reward:
  - {value: "distance(position, goal)", as: change, weight: -1.0}
  terminate: distance(position, goal) < 0.3
"""


def test_a_section_defines_a_complete_environment(tmp_path: Path) -> None:
    file = tmp_path / "learn.yaml"
    file.write_text(HEAD_ON.read_text(encoding="utf-8") + SECTION, encoding="utf-8")
    environment = sa.env(file)
    assert environment.observation_space("robot.0").shape == (3 + 2 + 8,)
    assert environment.action_space("robot.0").high.tolist() == [1.2, 1.2]
    assert environment.action_space("robot.0").low.tolist() == [0.0, -2.0]
    one = sa.single_env(file, "robot.3")
    assert one.agent == "robot.3"


@pytest.mark.parametrize(
    ("section", "path", "said"),
    [
        ({"agents": "robto"}, "learning.agents", "there is no agent or group `robto`"),
        ({"agents": ["robot.0", "robot.9"]}, "learning.agents[1]", "there is no agent or group `robot.9`"),
        ({"observation": ["x", "speedy"]}, "learning.observation[1]", "`speedy`: "),
        ({"observation": ["knowledge"]}, "learning.observation[0]", "it is not a number"),
        ({"observation": [{"signal": "scan.ranges"}]}, "learning.observation[0]", "have no signal `scan.ranges`"),
        ({"observation": [{"nearest": 0}]}, "learning.observation[0].nearest", "is 0"),
        ({"reward": "position"}, "learning.reward", "has 2 values for each agent, and a reward is one number"),
        ({"reward": ["always x > 0"]}, "learning.reward[0]", "belongs in a specification"),
        ({"reward": {"specification": "safe"}}, "learning.reward.specification", "there is no specification `safe`"),
        ({"reward": {"value": "x", "specification": "safe"}}, "learning.reward", "either a value or a specification"),
        ({"terminate": "x"}, "learning.terminate", "is not a condition"),
        ({"action": {"high": [1, 2, 3]}}, "learning.action", "`high` has 3 numbers for speed, turn_rate of `robot`"),
        ({"action": {"high": 9}}, "learning.action", "speed of `robot` is limited to 0 to 1.5"),
        ({"action": {"low": 1, "high": 1}}, "learning.action", "has no room between 1 and 1"),
        ({"inputs": "nothing.csv"}, "learning.inputs", "there is no file nothing.csv"),
        ({"inputs": "hello.yaml"}, "learning.inputs", "hello.yaml is no file of actions"),
    ],
)
def test_a_problem_of_the_section_is_located(section: dict[str, Any], path: str, said: str) -> None:
    with pytest.raises(sa.ScenarioError) as found:
        sa.load(HEAD_ON, {"learning": {"agents": "robot", **section}})
    problems = {each.path: each.message for each in found.value.problems}
    assert path in problems
    assert said in problems[path]


def test_a_scenario_with_the_section_runs_as_without_it(tmp_path: Path) -> None:
    plain = sa.load(HEAD_ON).run(duration=0.5, output=tmp_path / "plain.mcap")
    learning = sa.load(HEAD_ON, {"learning": {"agents": "robot"}}).run(duration=0.5, output=tmp_path / "learning.mcap")
    assert (plain.series("robot", "world").values == learning.series("robot", "world").values).all()
