"""Rows of vector environments equal single environments, byte for byte."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from learning_scenarios import HEAD_ON, REWARD, SCENARIOS, sampled

import symaware_cli as sa
from symaware_cli.learning.batched_rows import BatchedRows
from symaware_cli.learning.team import Team
from symaware_cli.learning.team_vector_environment import ScenarioTeamVectorEnv
from symaware_cli.learning.vector_environment import ScenarioVectorEnv

#: Episodes end at different steps, by a condition or with their duration; the speed of the robots is noisy.
TASK: dict[str, Any] = {
    "observation": ["state", "goal - position", {"nearest": 2}, "time"],
    "reward": [
        {"value": "-distance(position, goal)", "as": "change"},
        {"specification": "apart", "as": "change"},
        {"specification": "apart", "as": "verdict"},
    ],
    "terminate": "x > 4.9 or y > 1",
    "changes": {
        "agents.robot.model.with.process_noise": [0.5, 0.5, 0.1],
        "run.duration": 0.5,
        "specifications.apart": {"each": "robot", "formula": "always[0, 0.3] nearest > 3"},
    },
}

DRAWN = {"agents.robot.state": {"all": [{"uniform": [-5, 5]}, {"uniform": [-5, 5]}, 0.0]}}


def task(changes: dict[str, Any]) -> dict[str, Any]:
    return {**TASK, "changes": {**TASK["changes"], **changes}}


def assert_equal(found: Any, expected: Any) -> None:
    """Compare the values that two vector environments return, byte for byte."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        for key, each in expected.items():
            assert_equal(found[key], each)
    elif expected.dtype == object:
        for own, other in zip(found, expected, strict=True):
            assert (own is None) == (other is None)
            assert own is None or own.tobytes() == other.tobytes()
    else:
        assert (found.dtype, found.shape, found.tobytes()) == (expected.dtype, expected.shape, expected.tobytes())


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize(
    ("batched", "changes"), [(True, {}), (True, DRAWN), (False, {})], ids=["marked", "drawn", "separate"]
)
def test_rows_equal_the_vector_environment_that_gymnasium_makes_of_single_ones(
    mode: AutoresetMode, changes: dict[str, Any], batched: bool
) -> None:
    own = task(changes)
    rows = sa.vector_env(HEAD_ON, 4, "robot.1", **own, autoreset_mode=mode, batched=batched)
    single = SyncVectorEnv([lambda: sa.single_env(HEAD_ON, "robot.1", **own)] * 4, autoreset_mode=mode)
    assert isinstance(rows, ScenarioVectorEnv)
    assert rows.action_space == single.action_space
    random = np.random.default_rng(0)
    for found, expected in zip(rows.reset(seed=3), single.reset(seed=3), strict=True):
        assert_equal(found, expected)
    ends: set[tuple[int, int]] = set()
    for step in range(16):
        actions = random.uniform(rows.action_space.low, rows.action_space.high)
        result = rows.step(actions)
        for found, expected in zip(result, single.step(actions), strict=True):
            assert_equal(found, expected)
        over = result[2] | result[3]
        ends.update((step, row) for row in np.flatnonzero(over).tolist())
        if mode is AutoresetMode.DISABLED and over.any():
            (first, infos), (expected, said) = (
                each.reset(options={"reset_mask": over.copy()}) for each in (rows, single)
            )
            assert_equal(first[over], expected[over])
            assert_equal(infos, said)
    assert len({step for step, _ in ends}) > 2  # rows end at different steps


@pytest.mark.parametrize(("batched", "changes"), [(True, {}), (True, DRAWN), (False, {})])
def test_the_rows_of_a_team_equal_parallel_environments(batched: bool, changes: dict[str, Any]) -> None:
    own = task(changes)
    rows = sa.vector_env(HEAD_ON, 3, "robot", **own, batched=batched)
    single = [sa.env(HEAD_ON, "robot", **own) for _ in range(3)]
    assert isinstance(rows, ScenarioTeamVectorEnv)
    assert rows.agents == ("robot.0", "robot.1", "robot.2", "robot.3")
    random = np.random.default_rng(0)
    observed, _ = rows.reset(seed=3)
    for row, each in enumerate(single):
        assert observed[row].tobytes() == np.array([*each.reset(seed=3 + row)[0].values()]).tobytes()
    again = 0
    for _ in range(30):
        actions = random.uniform(rows.action_space.low, rows.action_space.high)
        observed, rewards, terminated, truncated, infos = rows.step(actions)
        for row, each in enumerate(single):
            if not each.agents:
                first, began = each.reset()
                assert observed[row].tobytes() == np.array([*first.values()]).tobytes()
                assert infos["_seed"][row]
                assert infos["seed"][row] == began["robot.0"]["seed"]
                again += 1
                continue
            live = each.agents
            result = each.step({id: actions[row, number] for number, id in enumerate(rows.agents) if id in live})
            for number, id in enumerate(rows.agents):
                assert infos["live"][row, number] == (id in live)
                if id in live:
                    assert observed[row, number].tobytes() == result[0][id].tobytes()
                    said = (rewards[row, number], terminated[row, number], truncated[row, number])
                    assert said == (result[1][id], result[2][id], result[3][id])
                    assert infos["present"][row, number] == result[4][id]["present"]
                else:
                    assert not observed[row, number].any()
    assert again > 3


def test_agents_that_enter_and_leave_are_masked() -> None:
    changes = {"agents.robot.present": [{}, {"from": 0.3}, {"until": 0.2}, {}]}
    rows = sa.vector_env(HEAD_ON, 2, "robot", reward=REWARD, changes=changes)
    assert rows.unbatched == "agents enter and leave"
    _, infos = rows.reset(seed=1)
    assert infos["present"].tolist() == [[True, False, True, True]] * 2
    for _ in range(8):
        _, _, terminated, _, infos = rows.step(np.full(rows.action_space.shape, np.nan))
    assert infos["present"].tolist() == [[True, True, False, True]] * 2
    assert terminated.tolist() == [[False, False, True, False]] * 2


def test_rows_driven_by_components_equal_the_runs_of_a_sweep(tmp_path: Any) -> None:
    changes = {"agents.robot.model.with.process_noise": [0.1, 0.1, 0.1], "run.duration": 1.0}
    rows = sa.vector_env(HEAD_ON, 4, "robot", observation="state", changes=changes)
    rows.reset(seed=9)
    for _ in range(20):
        observed, *_ = rows.step(np.full(rows.action_space.shape, np.nan))
    run = sa.load(HEAD_ON, changes).run(seed=int(rows.episodes.seeds[2]), output=tmp_path / "run.mcap")
    assert run.series("robot", "state").values[-1].tobytes() == observed[2].tobytes()


def test_a_batch_that_no_row_uses_begins_again() -> None:
    rows = sa.vector_env(HEAD_ON, 6, "robot.1", **TASK)
    assert isinstance(rows.episodes.source, BatchedRows)
    rows.reset(seed=1)
    random = np.random.default_rng(0)
    for _ in range(60):
        rows.step(random.uniform(rows.action_space.low, rows.action_space.high))
    first = rows.reset(seed=1)[0]
    assert first.tobytes() == sa.vector_env(HEAD_ON, 6, "robot.1", **TASK).reset(seed=1)[0].tobytes()
    assert rows.episodes.source.built < 20


def test_functions_of_rows_get_the_agents_of_all_environments() -> None:
    def centred(team: Team) -> np.ndarray:
        positions = team.believed("position").reshape(team.environments, -1, 2)
        return (positions - positions[:, :1]).reshape(-1, 2)

    rows = sa.vector_env(HEAD_ON, 3, "robot", observation=centred, mixes=False)
    assert rows.unbatched is None
    single = sa.env(HEAD_ON, "robot", observation=centred)
    observed, _ = rows.reset(seed=1)
    assert observed[2].tobytes() == np.array([*single.reset(seed=3)[0].values()]).tobytes()
    one_by_one = sa.vector_env(HEAD_ON, 1, "robot", observation=centred)
    assert (
        one_by_one.unbatched
        == "the function `observation` does not declare that it computes the rows of many environments"
    )


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"run.until": "time > 1"}, "`run.until` ends runs at different steps"),
        ({"run.mode": "asynchronous"}, "components of the asynchronous mode take their turns at instants of their own"),
        ({"topology": {"use": "complete"}}, "messages go over a network"),
    ],
)
def test_scenarios_that_cannot_be_batched_give_the_reason_and_are_refused_on_request(
    changes: dict[str, Any], said: str
) -> None:
    assert sa.vector_env(HEAD_ON, 1, "robot", changes=changes).unbatched == said
    with pytest.raises(sa.LearningError, match="the rows cannot be batched: "):
        sa.vector_env(HEAD_ON, 1, "robot", changes=changes, batched=True)


def test_agents_that_differ_in_their_inputs_are_refused() -> None:
    with pytest.raises(sa.LearningError, match="agents in one array have equal numbers of observed values"):
        sa.vector_env(SCENARIOS / "door.yaml", 1, ["door", "robot"])


Asked = Callable[[Any], object]


@pytest.mark.parametrize(
    ("ask", "error", "said"),
    [
        (lambda rows: rows.step(np.zeros((2, 3))), ValueError, r"the actions have shape \(2, 1, 3\), not \(2, 1, 2\)"),
        (lambda rows: rows.step([[0, 0], [0, np.inf]]), ValueError, "agent 0 in row 1 is not finite"),
        (lambda rows: rows.reset(seed=[1]), ValueError, "1 seeds for 2 rows"),
        (lambda rows: rows.reset(options={"reset_mask": np.zeros(2, bool)}), ValueError, "at least one of them true"),
        (lambda rows: [rows.step(np.zeros((2, 2))) for _ in range(3)], RuntimeError, "the episode of row 0 is over"),
    ],
)
def test_wrong_arguments_are_refused(ask: Asked, error: type[Exception], said: str) -> None:
    changes = {"run.duration": 0.1}
    rows = sa.vector_env(HEAD_ON, 2, "robot.1", changes=changes, autoreset_mode="disabled")
    rows.reset(seed=1)
    with pytest.raises(error, match=said):
        ask(rows)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"num_envs": 0}, "at least 1, not 0"),
        ({"num_envs": 1, "autoreset_mode": "never"}, "'never' is not one of next_step"),
    ],
)
def test_an_invalid_number_or_mode_is_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        sa.vector_env(HEAD_ON, agents="robot", **options)


def test_gymnasium_makes_the_vector_environment_by_its_name() -> None:
    name = "symaware_cli.learning.environments:symaware/Scenario-v0"
    rows = gymnasium.make_vec(name, 3, vectorization_mode="vector_entry_point", scenario=HEAD_ON, agent="robot.1")
    assert isinstance(rows, ScenarioVectorEnv)
    assert rows.reset(seed=1)[0].shape == (3, 3)


@pytest.mark.slow
def test_whole_episodes_of_many_rows_equal_single_environments() -> None:
    rows = sa.vector_env(HEAD_ON, 12, "robot", reward=REWARD)
    single = [sa.env(HEAD_ON, "robot", reward=REWARD) for _ in range(12)]
    random = np.random.default_rng(0)
    rows.reset(seed=5)
    for row, each in enumerate(single):
        each.reset(seed=5 + row)
    while single[0].agents:
        actions = [sampled(each, random) for each in single]
        observed, rewards, *_ = rows.step(np.array([[*each.values()] for each in actions]))
        for row, each in enumerate(single):
            found, reward, *_ = each.step(actions[row])
            assert observed[row].tobytes() == np.array([*found.values()]).tobytes()
            assert rewards[row].tolist() == [*reward.values()]
