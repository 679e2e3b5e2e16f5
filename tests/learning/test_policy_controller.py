"""The component `control.policy`: a trained policy drives agents as in an episode."""

from __future__ import annotations

import json
import shutil
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learning_scenarios import SCENARIOS
from numpy.typing import NDArray
from policy_files import model, node, recurrent
from simulating import in_process, untyped

import symaware_cli as sa
from symaware_cli.learning.policy import PolicyController
from symaware_cli.testing import assert_batchable, check_component

LEARNED = SCENARIOS / "learned.yaml"

DRIVE = "agents.robot.components.drive"


def linear(observed: int = 2, actions: int = 2) -> bytes:
    """Return a network without a hidden layer."""
    weights = {"w": 0.2 * np.ones((observed, actions), "<f4")}
    return model([node("MatMul", ["x", "w"], ["u"])], weights, {"x": ("n", observed)}, ["u"])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with learned.yaml and further policies."""
    shutil.copy(LEARNED, tmp_path)
    shutil.copytree(SCENARIOS / "policies", tmp_path / "policies")
    for name, content in {
        "linear": linear(),
        "wide": linear(observed=3),
        "one": linear(actions=1),
        "recurrent": recurrent(),
        "damaged": linear()[:-9],
    }.items():
        (tmp_path / "policies" / f"{name}.onnx").write_bytes(content)
    return tmp_path


def using(name: str) -> dict[str, Any]:
    return {f"{DRIVE}.with.policy.file": f"policies/{name}.onnx"}


def held(log: sa.Log, channel: str) -> NDArray[np.float64]:
    """Return the value that holds at each step, since a log has only the written ones."""
    series = log.series("robot", channel)
    return series.values[np.searchsorted(series.times, log.series("robot", "world").times[:-1], side="right") - 1]


#: The observation of the recurrent network.
FOUR = {"learning.observation": ["goal - position", "cos(heading)", "sin(heading)"]}


def test_the_component_conforms(folder: Path) -> None:
    policy = {"file": str(Path("policies", "linear.onnx"))}
    changes = {"learning": {"agents": "robot", "observation": ["position"]}}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        check_component(PolicyController, changes, policy=policy)


@pytest.mark.parametrize(("name", "observation"), [("goal", {}), ("recurrent", FOUR)])
def test_an_episode_driven_by_the_policy_is_the_run_of_its_index(
    folder: Path, name: str, observation: dict[str, Any]
) -> None:
    changes = {**observation, "run.duration": 4.0}
    policy = sa.Policy(folder / "policies" / f"{name}.onnx")
    environment = sa.env(folder / "learned.yaml", changes={**changes, DRIVE: None})
    environment.reset(seed=5)
    observations, infos = environment.reset()
    while environment.agents:
        actions = policy([observations[agent] for agent in environment.agents])
        observations, *_ = environment.step(dict(zip(environment.agents, actions, strict=True)))
    episode = sa.open_log(environment.record(folder / "episode.mcap"))
    settings = [f"--set={path}={json.dumps(value)}" for path, value in {**changes, **using(name)}.items()]
    with chdir(folder):
        done = in_process("run", "learned.yaml", "--seed=5", "--index=1", "-o", "run.mcap", *settings)
    assert done.returncode in (0, 3), done.stderr
    run = sa.open_log(folder / "run.mcap")
    assert run.manifest["seed"] == infos["robot.0"]["seed"]
    for channel in ("world", "requested_control", "applied_control"):
        assert held(run, channel).tobytes() == held(episode, channel).tobytes()
    (folder / "policies").rename(folder / "moved")
    assert sa.verify_log(folder / "run.mcap").is_equal


def test_a_run_with_a_recurrent_policy_continues_from_a_captured_state(folder: Path) -> None:
    scenario = sa.load(folder / "learned.yaml", {**FOUR, **using("recurrent")})
    whole = scenario.start(seed=2)
    for _ in range(30):
        whole.step()
    state = whole.capture()
    for _ in range(30):
        whole.step()
    other = scenario.start(seed=2)
    other.restore(sa.SimulationState.from_bytes(state.to_bytes()))
    for _ in range(30):
        other.step()
    assert other.state("robot").tobytes() == whole.state("robot").tobytes()
    assert other.control("robot").tobytes() == whole.control("robot").tobytes()


def test_a_policy_in_a_separate_process_gives_the_same_run(folder: Path) -> None:
    found = []
    for place in ("here", "process"):
        changes = {**FOUR, **using("recurrent"), f"{DRIVE}.run_in": "process"}
        if place == "here":
            del changes[f"{DRIVE}.run_in"]
        run = sa.load(folder / "learned.yaml", changes).run(duration=1.0, output=folder / f"{place}.mcap")
        found.append(run.series("robot", "world").values.tobytes())
    assert found[0] == found[1]


@pytest.mark.parametrize(
    ("name", "observation"),
    [
        ("goal", {}),
        ("recurrent", {"learning.observation": [{"nearest": 1}]}),
        ("linear", {"learning.observation": ["robustness['apart']", "norm(goal - position)"]}),
    ],
)
def test_runs_with_a_policy_are_batched_to_the_same_bytes(folder: Path, name: str, observation: dict[str, Any]) -> None:
    changes = {**observation, **using(name), "run.duration": 0.5}
    assert_batchable(folder / "learned.yaml", [f"{path}={json.dumps(value)}" for path, value in changes.items()])


def test_agents_that_do_not_learn_may_follow_the_policy(folder: Path) -> None:
    found = []
    for agents in ("robot", "robot.0"):
        scenario = sa.load(folder / "learned.yaml", {"learning.agents": agents})
        run = scenario.run(duration=1.0, output=folder / f"{agents}.mcap")
        found.append(run.series("robot", "world").values.tobytes())
    assert found[0] == found[1]


def test_a_recurrent_policy_is_reset_while_its_agent_is_absent(folder: Path) -> None:
    present = [{"until": 0.5}, {}, {}, {}]
    changes = {**FOUR, **using("recurrent"), "agents.robot.present": present}
    environment = sa.env(folder / "learned.yaml", changes=changes)
    environment.reset()
    for _ in range(8):
        environment.step({})
    (drive,) = (each for each in environment.episodes.built.simulation.entries if each.name == "drive")
    (states,) = untyped(drive.components[0])._states
    assert not states[0, 0].any()
    assert states[0, 1:].all()


#: The agents that follow the policy have no goal; those that learn have one.
WITHOUT_GOAL = {
    "learning": {"agents": "other", "observation": ["goal"]},
    "agents.other": {"model": {"use": "unicycle"}, "state": [9, 9, 0], "knowledge": {"goal": [0, 0]}},
    "agents.robot.knowledge": None,
    "specifications": None,
}


@pytest.mark.parametrize(
    ("changes", "path", "said"),
    [
        (using("nothing"), f"{DRIVE}.with.policy.file", "there is no file `policies/nothing.onnx`"),
        (using("wide"), f"{DRIVE}.with.policy.file", "it observes 3 values, and `learning.observation` has 2"),
        (using("one"), f"{DRIVE}.with.policy.file", r"its output has 1 values, .* this model 2 \(speed, turn_rate\)"),
        (using("damaged"), f"{DRIVE}.with.policy.file", "policies/damaged.onnx: it is no ONNX file, or damaged: byte "),
        (using("../../x"), f"{DRIVE}.with.policy.file", "a file lies below the scenario's folder"),
        ({"learning": None}, f"{DRIVE}.use", "needs the observations of the section `learning`, and there is none"),
        ({"learning.observation": ["speedy"]}, "learning.observation[0]", "`speedy`: "),
        (
            WITHOUT_GOAL,
            f"{DRIVE}.use",
            "agents of `robot` do not have the observations of `learning.observation`: `goal`: ",
        ),
    ],
)
def test_a_policy_that_does_not_fit_the_scenario_is_located(
    folder: Path, changes: dict[str, Any], path: str, said: str
) -> None:
    with pytest.raises(sa.ScenarioError, match=said) as found:
        sa.load(folder / "learned.yaml", changes).run(record=False)
    assert {each.path for each in found.value.problems} == {path}
