"""Values for each agent: literal, one for each, or drawn."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from simulating import untyped

from symaware_cli.language.build import Built
from symaware_cli.language.problem import Problem

Building = Callable[..., Built]
Problems = Callable[..., list[Problem]]

pytestmark = pytest.mark.usefixtures("known_plugins")


def states(built: Built) -> list[list[float]]:
    result: list[list[float]] = built.simulation.groups[0].initial_state.tolist()
    return result


def known(built: Built, name: str = "fact") -> list[Any]:
    values = [knowledge[name] for knowledge in built.simulation.groups[0].knowledge]
    return [value.tolist() if isinstance(value, np.ndarray) else value for value in values]


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        (None, [[0, 0, 0], [0, 0, 0]]),
        ([1, 2, 3], [[1, 2, 3], [1, 2, 3]]),
        ([[1, 2, 3], [4, 5, 6]], [[1, 2, 3], [4, 5, 6]]),
        ({"each": [[1, 2, 3], [4, 5, 6]]}, [[1, 2, 3], [4, 5, 6]]),
        ({"all": [1, 2, 3]}, [[1, 2, 3], [1, 2, 3]]),
        ({"uniform": [2, 2]}, [[2, 2, 2], [2, 2, 2]]),
        ({"uniform": [[1, 2, 3], [1, 2, 3]]}, [[1, 2, 3], [1, 2, 3]]),
        ({"normal": [[1, 2, 3], 0]}, [[1, 2, 3], [1, 2, 3]]),
        ([{"uniform": [5, 5]}, 2, {"normal": [3, 0]}], [[5, 2, 3], [5, 2, 3]]),
        ({"each": [[{"uniform": [5, 5]}, 2, 3], {"uniform": [1, 1]}]}, [[5, 2, 3], [1, 1, 1]]),
        ({"grid": {}}, [[0, 0, 0], [1, 0, 0]]),
        ({"grid": {"columns": 1, "spacing": [2, 3], "origin": [1, 1], "heading": 0.5}}, [[1, 1, 0.5], [1, 4, 0.5]]),
        ({"circle": {"radius": 2, "heading": "outward"}}, [[2, 0, 0], [-2, 0, math.pi]]),
        (
            {"circle": {"radius": 2, "centre": [1, 1], "phase": math.pi / 2}},
            [[1, 3, -math.pi / 2], [1, -1, math.pi / 2]],
        ),
    ],
)
def test_each_form_of_a_state(building: Building, state: object, expected: list[list[float]]) -> None:
    np.testing.assert_allclose(states(building(state=state)), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("fact", "expected"),
    [
        (3, [3, 3]),
        ("north", ["north", "north"]),
        (True, [True, True]),
        (None, [None, None]),
        ([1, 2], [[1, 2], [1, 2]]),
        ([[1, 2], [3, 4]], [[1, 2], [3, 4]]),
        ({"each": [1, 2]}, [1, 2]),
        ({"each": ["a", [1, 2]]}, ["a", [1, 2]]),
        ({"all": [[1, 2], [3, 4]]}, [[[1, 2], [3, 4]], [[1, 2], [3, 4]]]),
        ({"all": [[1, 2], [3]]}, [[[1, 2], [3]], [[1, 2], [3]]]),
        ({"uniform": [2, 2]}, [2.0, 2.0]),
        ([{"uniform": [2, 2]}, 5], [[2, 5], [2, 5]]),
        ([[{"uniform": [2, 2]}, 5], [1, 2]], [[2, 5], [1, 2]]),
        ({"grid": {"spacing": 3}}, [[0, 0], [3, 0]]),
        ({"grid": {"origin": [1, 2, 3]}}, [[1, 2, 3], [2, 2, 3]]),
        ({"speed": 3, "colour": "red"}, [{"speed": 3, "colour": "red"}] * 2),
        ({"reach": 3}, [{"reach": 3}] * 2),
        ({}, [{}, {}]),
        ([{"at": [1, 2]}, {"at": [3, 4]}], [[{"at": [1, 2]}, {"at": [3, 4]}]] * 2),
        ({"all": {"norml": 3}}, [{"norml": 3}] * 2),
    ],
)
def test_each_form_of_knowledge(building: Building, fact: object, expected: object) -> None:
    assert known(building(knowledge={"goal": [0, 0], "fact": fact})) == expected


def test_a_list_of_lists_is_one_value_where_there_is_one_agent_without_a_count(building: Building, sound: Any) -> None:
    del sound["agents"]["robot"]["count"]
    way = [[1, 2], [{"uniform": [3, 3]}, 4]]
    assert known(building(sound, knowledge={"goal": [0, 0], "fact": way})) == [[[1, 2], [3, 4]]]
    assert states(building(sound, state=[[1, 2, 3]])) == [[1, 2, 3]]


def test_a_model_without_a_heading_takes_the_position_only(building: Building) -> None:
    model = {"use": "single-integrator"}
    assert states(building(model=model, state={"grid": {"heading": 2.0}})) == [[0, 0], [1, 0]]


def test_a_state_of_one_number_can_be_drawn(building: Building) -> None:
    built = building(model={"use": "sound.line"}, state={"uniform": [2, 2]}, components={})
    assert states(built) == [[2], [2]]


@pytest.mark.parametrize(
    ("state", "code", "path", "message"),
    [
        ("x", "wrong-type", "state", "the state is the text `x`"),
        (3, "wrong-type", "state", "the state is 3"),
        ({}, "bad-distribution", "state", "`agents.robot.state` is an empty mapping"),
        ([1, 2], "wrong-length", "state", "the state has 2 elements"),
        ([1, 2, None], "wrong-type", "state[2]", "element 2 (heading) of the state is empty (null)"),
        ([1, 2, 3, "x"], "wrong-type", "state[3]", "element 3 of the state is the text `x`"),
        ([[1, 2, 3], 5], "wrong-type", "state[1]", "the state is 5"),
        ({"each": [1]}, "wrong-count", "state.each", "`agents.robot.state` gives 1 value for 2 agents"),
        ({"all": [1]}, "wrong-length", "state.all", "the state has 1 element"),
        ({"uniform": []}, "wrong-length", "state.uniform", "`agents.robot.state.uniform` is an empty list"),
        (
            {"uniform": [0, []]},
            "wrong-length",
            "state.uniform[1]",
            "`agents.robot.state.uniform[1]` is an empty list",
        ),
        ({"uniform": [0, True]}, "wrong-type", "state.uniform[1]", "`agents.robot.state.uniform[1]` is true"),
        (
            {"uniform": [[0, 0, 0], [1, 1, None]]},
            "wrong-type",
            "state.uniform[1][2]",
            "`agents.robot.state.uniform[1][2]` is empty (null)",
        ),
        ({"uniform": [-1e10, 1e10]}, "out-of-range", "state.uniform", "the distribution is too wide"),
        ([{"uniform": [[0, 0], 1]}, 0, 0], "wrong-type", "state[0]", "element 0 (x) of the state is a list of 2"),
        (
            [{"circle": {"radius": 1}}, 0, 0],
            "bad-distribution",
            "state[0].circle",
            "`circle` gives a whole state, not one element",
        ),
        (
            {"grid": {"spacing": 1e9, "origin": [1e9, 0]}},
            "out-of-range",
            "state",
            "`agents.robot.state` evaluates to 2000000000.0",
        ),
    ],
)
def test_values_that_are_no_state(problems: Problems, state: object, code: str, path: str, message: str) -> None:
    (problem,) = problems(state=state)
    assert (problem.code, problem.path, problem.message) == (code, f"agents.robot.{path}", message)


def test_a_state_of_the_wrong_length_names_the_elements_of_the_model(problems: Problems) -> None:
    (problem,) = problems(state=[1, 2])
    assert problem.expected == "3 numbers: x [m], y [m], heading [rad]"


def test_exactly_the_bad_elements_of_a_drawn_state_are_reported(problems: Problems) -> None:
    found = problems(state=[{"uniform": [1, 0]}, {"normal": [0, -1]}, {"gauss": 0}])
    assert [problem.path.removeprefix("agents.robot.state") for problem in found] == [
        "[0].uniform",
        "[1].normal[1]",
        "[2].gauss",
    ]


def test_of_a_thousand_bad_states_only_some_are_reported(problems: Problems) -> None:
    assert len(problems(count=1000, state=[[0]] * 1000, knowledge={"goal": [0, 0]})) < 20


def test_a_slip_in_the_name_of_a_distribution_is_not_taken_for_knowledge(problems: Problems) -> None:
    for name in ("unifrom", "norml", "gird", "cirlce", "Uniform"):
        (problem,) = problems(knowledge={"goal": [0, 0], "fact": {name: [0, 1]}})
        assert problem.message == f"unknown distribution `{name}`"
        assert problem.suggestion in ("uniform", "normal", "grid", "circle")


def test_draws_of_golden_seeds_stay_the_same(building: Building) -> None:
    # Computed once with Philox-4x32-10 and BLAKE2b keys; a change here changes every run that was ever recorded.
    drawn = states(building(state={"uniform": [0, 1]}, seed=1))
    assert drawn == [
        [0.46629419522409266, 0.7768850680249297, 0.27206293482642674],
        [0.42791366848479817, 0.22709627776355568, 0.30423361933019966],
    ]
    drawn = states(building(state=[{"normal": [0, 1]}, 0, {"normal": [10, 2]}], seed=2))
    assert drawn == [[1.7566556633077586, 0.0, 10.958667071867978], [0.4524570325765805, 0.0, 13.582208117568381]]


def test_another_seed_draws_other_values(building: Building) -> None:
    one, two, again = (states(building(state={"uniform": [0, 1]}, seed=seed)) for seed in (1, 2, 1))
    assert one == again
    assert not np.equal(one, two).any()


def test_elements_agents_and_names_draw_independently(building: Building) -> None:
    built = building(
        state={"uniform": [0, 1]},
        knowledge={"goal": {"uniform": [[0, 0], [1, 1]]}, "fact": {"uniform": [[0, 0], [1, 1]]}},
    )
    drawn = [*np.ravel(states(built)), *np.ravel(known(built)), *np.ravel(known(built, "goal"))]
    assert len(set(drawn)) == len(drawn) == 14


def test_adding_agents_groups_and_knowledge_does_not_change_draws_of_others(building: Building, sound: Any) -> None:
    state = [{"uniform": [-5, 5]}, {"normal": [0, 1]}, 0]
    fact = {"normal": [[0, 0], 1]}
    few = building(sound, count=3, state=state, knowledge={"goal": [0, 0], "fact": fact})
    sound["agents"] = {"other": dict(sound["agents"]["robot"], state=state), **sound["agents"]}
    many = building(sound, count=7, state=state, knowledge={"goal": [0, 0], "more": fact, "fact": fact})
    group = next(group for group in many.simulation.groups if group.name == "robot")
    assert group.initial_state[:3].tolist() == states(few)
    assert [each["fact"].tolist() for each in group.knowledge[:3]] == known(few)
    others = next(group for group in many.simulation.groups if group.name == "other")
    assert not np.equal(others.initial_state[:, :2], group.initial_state[:2, :2]).any()


def test_uniform_fills_its_interval_evenly(building: Building) -> None:
    drawn = np.array(states(building(count=4000, state={"uniform": [[-1, 0, 2], [1, 10, 2]]})))
    assert (drawn >= [-1, 0, 2]).all()
    assert (drawn <= [1, 10, 2]).all()
    # The mean of 4000 draws lies within 4 standard errors of the middle.
    np.testing.assert_allclose(drawn.mean(0), [0, 5, 2], atol=4 * 10 / math.sqrt(12 * 4000))
    np.testing.assert_allclose(np.quantile(drawn[:, 0], [0.25, 0.75]), [-0.5, 0.5], atol=0.06)
    assert abs(np.corrcoef(drawn[:, 0], drawn[:, 1])[0, 1]) < 0.07


def test_normal_has_its_mean_and_deviation(building: Building) -> None:
    drawn = np.array(states(building(count=4000, state={"normal": [[0, 10, -5], [1, 3, 0]]})))
    np.testing.assert_allclose(drawn.mean(0), [0, 10, -5], atol=4 * 3 / math.sqrt(4000))
    np.testing.assert_allclose(drawn.std(0), [1, 3, 0], rtol=0.06)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(count=st.integers(1, 12), radius=st.floats(0.01, 1e6), phase=st.floats(-10, 10))
def test_a_circle_spaces_agents_evenly_facing_inward(
    building: Building, count: int, radius: float, phase: float
) -> None:
    drawn = np.array(states(building(count=count, state={"circle": {"radius": radius, "phase": phase}})))
    position, heading = drawn[:, :2], drawn[:, 2]
    np.testing.assert_allclose(np.hypot(*position.T), radius, rtol=1e-9)
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    np.testing.assert_allclose(np.einsum("ij,ij->i", ahead, position), -radius, rtol=1e-9)
    assert (np.abs(heading) <= math.pi).all()
    if count > 1:
        gaps = np.linalg.norm(position - np.roll(position, 1, axis=0), axis=1)
        np.testing.assert_allclose(gaps, 2 * radius * math.sin(math.pi / count), rtol=1e-6)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(count=st.integers(1, 30), columns=st.none() | st.integers(1, 9), spacing=st.floats(0.01, 100))
def test_no_two_agents_share_a_place_on_a_grid(
    building: Building, count: int, columns: int | None, spacing: float
) -> None:
    grid = {"spacing": spacing} if columns is None else {"spacing": spacing, "columns": columns}
    drawn = np.array(states(building(count=count, state={"grid": grid})))
    cells = {tuple(cell) for cell in np.round(drawn[:, :2] / spacing).astype(int).tolist()}
    assert len(cells) == count
    wide = columns or math.ceil(math.sqrt(count))
    assert max(column for column, _ in cells) < wide
    np.testing.assert_allclose(drawn[0], 0)


def test_the_global_random_state_is_not_read(building: Building) -> None:
    np.random.seed(1)  # noqa: NPY002
    one = states(building(state={"uniform": [0, 1]}))
    before = untyped(np.random.get_state())[1].tolist()  # noqa: NPY002
    assert states(building(state={"uniform": [0, 1]})) == one
    assert untyped(np.random.get_state())[1].tolist() == before  # noqa: NPY002


def test_a_group_of_many_agents_is_drawn_in_reasonable_time(building: Building, tmp_path: Path) -> None:
    built = building(count=5000, state=[{"uniform": [0, 1]}, 0, 0], knowledge={"goal": {"uniform": [[0, 0], [1, 1]]}})
    assert built.simulation.agent_count == 5000
