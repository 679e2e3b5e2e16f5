from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from learning_scenarios import (
    HEAD_ON,
    REWARD,
    TEN,
    digest,
    head_on,
    parallel_api_test,
    parallel_seed_test,
    sampled,
    shipped,
    shortened,
)
from pettingzoo.utils.conversions import parallel_to_aec

import symaware_cli as sa
from symaware_cli.learning.team import Team


def test_the_libraries_accept_the_environment_of_a_scenario() -> None:
    parallel_api_test(head_on(changes={"run.duration": 1.0}), num_cycles=30)
    parallel_seed_test(head_on, num_cycles=5)


# Gymnasium advises bounded observations and symmetric actions, which a scenario need not have.
@pytest.mark.filterwarnings("ignore:.*(symmetric and normalized|infinity):UserWarning")
def test_gymnasium_accepts_the_environment_of_one_agent() -> None:
    name = "symaware_cli.learning.environments:symaware/Scenario-v0"
    made = gymnasium.make(name, scenario=HEAD_ON, agent="robot.1", reward=REWARD)
    check_env(made.unwrapped, skip_render_check=True)


def test_the_aec_wrapper_of_pettingzoo_steps_one_agent_after_the_other() -> None:
    turns = parallel_to_aec(head_on())
    turns.reset(seed=1)
    agents = []
    for agent in turns.agent_iter(8):
        agents.append(agent)
        turns.step(turns.action_space(agent).sample())
    assert agents == ["robot.0", "robot.1", "robot.2", "robot.3"] * 2


def test_whole_episodes_are_equal_for_equal_seeds_and_actions() -> None:
    one, other = (head_on(changes={"run.duration": 2.0}) for _ in range(2))
    first = digest(one, seed=3, actions=0)
    digest(one, seed=4, actions=1)
    assert digest(one, seed=3, actions=0) == digest(other, seed=3, actions=0) == first


@pytest.mark.parametrize("name", ["fog", "gatekeeper"])
def test_episodes_that_go_back_or_are_built_anew_are_equal_for_equal_seeds(name: str) -> None:
    one, other = shipped(name), shipped(name)
    first = digest(one, 3, 0, most=12)
    digest(one, 4, 1, most=12)
    assert digest(one, 3, 0, most=12) == digest(other, 3, 0, most=12) == first
    assert one.episodes.returns is (name == "gatekeeper")  # nothing there is drawn before the first step


def test_an_episode_driven_by_components_equals_the_run_of_its_index(tmp_path: Path) -> None:
    environment = head_on(changes={"agents.robot.model.with.process_noise": [0.1, 0.1, 0.1]})
    environment.reset(seed=9)
    _, infos = environment.reset()
    while environment.agents:
        *_, truncations, _ = environment.step({})
    assert all(truncations.values())
    table = sa.sweep(
        HEAD_ON,
        tmp_path / "swept",
        runs=2,
        seed=9,
        keep="all",
        changes={"agents.robot.model.with.process_noise": [0.1, 0.1, 0.1]},
    )
    assert table["seed"].to_pylist()[1] == infos["robot.0"]["seed"]
    logs = {sa.open_log(each).manifest["seed"]: each for each in (tmp_path / "swept").rglob("*.mcap")}
    log = logs[infos["robot.0"]["seed"]]
    recorded = sa.open_log(log).series("robot", "world").values[-1]
    assert recorded.tobytes() == environment.episodes.simulation.state("robot").tobytes()


@pytest.mark.parametrize("most", [1, 30, 1000])
def test_a_recorded_episode_is_verified_from_its_log_alone(tmp_path: Path, most: int) -> None:
    environment = head_on(changes={"run.duration": 4.0})
    random = np.random.default_rng(2)
    environment.reset(seed=5)
    count = 0
    while environment.agents and count < most:
        environment.step(sampled(environment, random) if count % 3 else {"robot.2": np.array([0.5, 1.0])})
        count += 1
    path = environment.record(tmp_path / "episode.mcap")
    environment.close()
    verified = sa.verify_log(path)
    assert verified.is_equal
    assert verified.is_whole
    assert (sa.open_log(path).outcome or {})["steps"] == count
    requested = sa.open_log(path).series("robot", "requested_control").values
    assert requested[0, 2].tolist() == [0.5, 1.0]


def test_the_components_of_an_agent_without_an_action_drive_it() -> None:
    environment = head_on()
    environment.reset(seed=1)
    for _ in range(20):
        environment.step({"robot.0": np.zeros(2)})
    state = environment.episodes.simulation.state("robot", "x", "y")
    start = environment.episodes.built.simulation.groups[0].initial_state[:, :2]
    moved = np.linalg.norm(state - start, axis=1)
    assert moved[0] == 0.0
    assert (moved[1:] > 1.0).all()


def test_an_agent_observes_what_it_perceives_at_the_instant_at_which_it_acts() -> None:
    environment = head_on(observation=["state", "goal - position"])
    observations, _ = environment.reset(seed=1)
    for _ in range(3):
        true = environment.episodes.simulation.state("robot.0")
        assert observations["robot.0"][:3].tolist() == true.tolist()
        observations, *_ = environment.step({"robot.0": np.array([1.0, 0.5])})


def test_the_nearest_others_come_first_and_missing_ones_are_zeros() -> None:
    environment = head_on(observation=[{"nearest": 5, "of": ["distance", "present"]}])
    observations, _ = environment.reset(seed=1)
    pairs = observations["robot.0"].reshape(5, 2)
    assert pairs[:, 1].tolist() == [1.0, 1.0, 1.0, 0.0, 0.0]
    assert pairs[:3, 0] == pytest.approx([50**0.5, 50**0.5, 10.0])
    assert pairs[3:, 0].tolist() == [0.0, 0.0]


def test_a_reward_is_a_sum_of_values_and_changes() -> None:
    terms = [{"value": "distance(position, goal)", "as": "change", "weight": -2.0}, "1"]
    environment = head_on()
    changing = sa.env(HEAD_ON, agents="robot", reward=terms)
    environment.reset(seed=1)
    changing.reset(seed=1)
    before = -10.0
    for _ in range(3):
        _, distances, *_ = environment.step({})
        _, rewards, *_ = changing.step({})
        assert rewards["robot.0"] == pytest.approx(1.0 + 2.0 * (distances["robot.0"] - before))
        before = distances["robot.0"]


SAFE = {"specifications": {"safe": {"each": "robot", "formula": "always nearest > 0.6"}}}


def test_the_changes_of_a_robustness_add_up_to_that_of_the_episode() -> None:
    environment = sa.env(
        HEAD_ON,
        agents="robot",
        reward={"specification": "safe", "as": "value"},
        changes={"specifications.safe": SAFE["specifications"]["safe"], "run.duration": 6.0},
    )
    environment.reset(seed=1)
    rewards = []
    while environment.agents:
        _, reward, *_ = environment.step({})
        rewards.append(reward["robot.0"])
    assert rewards == sorted(rewards, reverse=True)  # the least distance so far, less 0.6 m
    outcome = environment.episodes.simulation.result.summary.specifications[0]
    assert outcome.robustness == pytest.approx(rewards[-1], abs=1e-6)


def test_the_reward_at_a_verdict_comes_once() -> None:
    environment = sa.env(
        HEAD_ON,
        agents="robot",
        reward={"specification": "near", "as": "verdict"},
        changes={"specifications.near": {"each": "robot", "formula": "eventually distance(position, goal) < 5"}},
    )
    environment.reset(seed=1)
    rewards = []
    while environment.agents:
        _, reward, *_ = environment.step({})
        rewards.append(reward["robot.0"])
    given = [each for each in rewards if each != 0.0]
    assert len(given) == 1
    assert 0.0 < given[0] < 0.13  # it moves 0.06 m in a step


def test_a_condition_terminates_one_agent_and_the_others_go_on() -> None:
    environment = sa.env(HEAD_ON, agents="robot", terminate="x > 4")  # robot.0 begins at x = 5
    environment.reset(seed=1)
    _, _, terminations, truncations, _ = environment.step({})
    assert [agent for agent, over in terminations.items() if over] == ["robot.0"]
    assert not any(truncations.values())
    assert environment.agents == ["robot.1", "robot.2", "robot.3"]
    environment.step({"robot.0": np.zeros(2)})  # its actions no longer count
    assert environment.episodes.simulation.control("robot.0")[0] > 0.0


def test_a_run_that_ends_before_its_duration_terminates_all() -> None:
    environment = head_on(changes={"run.until": "time >= 0.2"})
    environment.reset(seed=1)
    steps = 0
    while environment.agents:
        _, _, terminations, truncations, _ = environment.step({})
        steps += 1
    assert steps == 5  # the last one ends where the condition holds, after the turns of that instant
    assert all(terminations.values())
    assert not any(truncations.values())


def test_agents_that_come_later_wait_and_agents_that_leave_are_terminated() -> None:
    environment = head_on(changes={"agents.robot.present": [{}, {"from": 0.3}, {"until": 0.2}, {}]})
    observations, infos = environment.reset(seed=1)
    assert not infos["robot.1"]["present"]
    assert not observations["robot.1"].any()
    came = left = None
    for step in range(10):
        observations, _, terminations, _, infos = environment.step({})
        if came is None and infos["robot.1"]["present"]:
            came = step
        if terminations.get("robot.2"):
            left = step
    assert (came, left) == (5, 3)
    assert observations["robot.1"].any()
    assert environment.agents == ["robot.0", "robot.1", "robot.3"]


def test_functions_observe_reward_and_terminate() -> None:
    def observe(team: Team) -> np.ndarray:
        return np.concatenate([team.believed("position"), team.nearest(1, ["distance"])], axis=1)

    def reward(team: Team) -> np.ndarray:
        return -team.true("norm(position)")[:, 0]

    environment = sa.env(
        HEAD_ON, agents="robot", observation=observe, reward=reward, terminate=lambda team: team.true("x")[:, 0] > 4
    )
    observations, _ = environment.reset(seed=1)
    assert observations["robot.0"] == pytest.approx([5.0, 0.0, 50**0.5])
    _, rewards, terminations, *_ = environment.step({})
    assert rewards["robot.0"] == pytest.approx(-4.94)
    assert terminations["robot.0"]


def test_a_function_of_another_shape_is_refused() -> None:
    environment = sa.env(HEAD_ON, agents="robot", reward=lambda team: np.zeros(3))
    environment.reset()
    with pytest.raises(sa.LearningError, match=r"the reward has shape \(3,\), not \(4,\)"):
        environment.step({})


@pytest.mark.parametrize(
    ("actions", "error", "said"),
    [
        ({"robot.0": [1.0]}, ValueError, r"the action of robot\.0 has shape \(1,\), not \(2,\)"),
        ({f"robot.{row}": [[1.0], [0.0]] for row in range(4)}, ValueError, r"robot\.0 has shape \(2, 1\), not \(2,\)"),
        ({"robot.0": [1.0, np.nan]}, ValueError, r"the action of robot\.0 is not finite"),
        ({f"robot.{row}": [row, np.inf] for row in range(4)}, ValueError, r"the action of robot\.0 is not finite"),
        ({"robot.4": [1.0, 0.0]}, KeyError, r"robot\.4 is no agent that learns"),
    ],
)
def test_actions_that_cannot_be_control_inputs_are_refused(
    actions: dict[str, Any], error: type[Exception], said: str
) -> None:
    environment = head_on()
    environment.reset()
    with pytest.raises(error, match=said):
        environment.step(actions)


def test_one_environment_of_gymnasium_has_one_learning_agent() -> None:
    with pytest.raises(sa.LearningError, match=r"4 agents learn: name one of robot\.0, robot\.1"):
        sa.single_env(HEAD_ON, "robot")


def test_a_scenario_without_learning_agents_is_refused() -> None:
    with pytest.raises(sa.LearningError, match="name the agents that learn"):
        sa.env(HEAD_ON)


@pytest.mark.parametrize(("make", "package"), [(sa.env, "pettingzoo"), (sa.single_env, "gymnasium")])
def test_a_missing_library_is_named_with_its_extra(
    make: Callable[..., object], package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=rf"environments need {package}: pip install 'symaware-cli\[rl\]'"):
        make(HEAD_ON, "robot.0")


def test_a_scenario_without_the_section_loads_nothing_for_it() -> None:
    said = f"""if True:
        import sys, symaware_cli
        symaware_cli.load({str(HEAD_ON)!r}).run(record=False, duration=0.1)
        assert not [name for name in sys.modules if "learning" in name or name in ("gymnasium", "pettingzoo")]
    """
    subprocess.run([sys.executable, "-c", said], check=True)


def test_a_frame_shows_the_world_from_above() -> None:
    environment = head_on(render_mode="rgb_array")
    environment.reset(seed=1)
    frame = environment.render()
    environment.step({})
    later = environment.render()
    assert frame is not None
    assert later is not None
    assert frame.shape == later.shape == (480, 480, 3)
    assert (frame != 255).any()
    assert (frame != later).any()


@pytest.mark.slow
@pytest.mark.parametrize("name", TEN)
def test_shipped_scenarios_are_environments_with_repeatable_episodes(name: str, tmp_path: Path) -> None:
    environment = shipped(name)
    parallel_api_test(shipped(name), num_cycles=50)
    parallel_seed_test(lambda: shipped(name), num_cycles=5)
    first = digest(environment, 3, 0)
    assert sa.verify_log(environment.record(tmp_path / "episode.mcap")).is_equal
    digest(environment, 4, 1, most=20)
    assert digest(environment, 3, 0) == digest(shipped(name), 3, 0) == first


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*(symmetric and normalized|infinity):UserWarning")
@pytest.mark.parametrize("name", TEN)
def test_gymnasium_accepts_one_agent_of_shipped_scenarios(name: str) -> None:
    scenario, group = shortened(name)
    assert scenario.outline is not None
    agent = scenario.outline.groups[group].agents[0]
    check_env(sa.single_env(scenario, agent, reward="-norm(position)"), skip_render_check=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", TEN)
def test_ten_episodes_of_random_actions_are_verified_from_their_logs(name: str, tmp_path: Path) -> None:
    environment, random = shipped(name, 0.3), np.random.default_rng(1)
    seeds = set()
    environment.reset(seed=1)
    for _ in range(10):
        while environment.agents:
            environment.step(sampled(environment, random))
        seeds.add(environment.episodes.seed)
        assert sa.verify_log(environment.record(tmp_path / "episode.mcap")).is_equal
        environment.reset()
    assert len(seeds) == 10


@pytest.mark.slow
@pytest.mark.parametrize("name", TEN)
def test_ten_episodes_driven_by_components_equal_their_runs(name: str) -> None:
    environment, (scenario, _) = shipped(name, 0.5), shortened(name, 0.5)
    assert scenario.outline is not None
    environment.reset(seed=3)
    for _ in range(10):
        while environment.agents:
            environment.step({})
        episode = environment.episodes.simulation
        with scenario.start(seed=environment.episodes.seed) as simulation:
            while simulation.steps < episode.steps:
                simulation.step()
            for group in scenario.outline.groups:
                assert simulation.state(group).tobytes() == episode.state(group).tobytes()
        environment.reset()


def test_an_agent_that_returns_stays_among_the_agents_and_observes_zeros_meanwhile(tmp_path: Path) -> None:
    environment = sa.env(HEAD_ON.with_name("shifts.yaml"))
    parallel_api_test(environment, num_cycles=20)
    environment.reset(seed=1)
    flags: list[bool] = []
    while environment.agents:
        assert environment.agents == ["guard.0", "guard.1"]
        observations, rewards, terminations, _, infos = environment.step({})
        flags.append(infos["guard.0"]["present"])
        assert observations["guard.0"].any() == flags[-1]
        assert flags[-1] or rewards["guard.0"] == 0.0
        assert not terminations["guard.0"]
    absent = [step for step, present in enumerate(flags, 1) if not present]
    assert absent == list(range(30, 60))
    assert sa.verify_log(environment.record(tmp_path / "episode.mcap")).is_equal


def test_rows_with_agents_that_return_have_the_reason_why_they_are_no_batch() -> None:
    rows = sa.vector_env(HEAD_ON.with_name("shifts.yaml"), 2)
    assert rows.unbatched == "agents enter and leave"
    rows.reset(seed=1)
    for _ in range(40):
        *_, terminated, _, infos = rows.step(np.full((2, 2, 2), np.nan))
    assert not terminated.any()
    assert infos["live"].all()
    assert not infos["present"][:, 0].any()


def test_an_agent_that_returns_and_then_leaves_for_good_is_terminated_at_the_end_only() -> None:
    present = [{"until": 0.2, "again": [{"from": 0.4, "until": 0.6}]}, {}, {}, {}]
    environment = head_on(changes={"agents.robot.present": present})
    environment.reset(seed=1)
    ended = []
    for step in range(1, 16):
        *_, terminations, _, _ = environment.step({})
        ended += [step] * bool(terminations.get("robot.0"))
    assert ended == [12]
    assert "robot.0" not in environment.agents
