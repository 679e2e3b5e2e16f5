"""Above 10,000 pairs the closest one stands for all of them, exactly."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from symaware_cli import open_log
from symaware_cli.geometry.proximity import ClosestPair, closest_pair, nearest_distances
from symaware_cli.geometry.vectors import lengths
from symaware_cli.language import specifications
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError
from symaware_cli.specification.closest_pair import check_least
from symaware_cli.specification.columns import ARGUMENTS
from symaware_cli.specification.outcome import Outcome
from symaware_cli.specification.parser import parse
from symaware_cli.specification.scope import PAIR_UNITS
from symaware_cli.specification.token import ExpressionError


def scattered(count: int, seed: int, dimensions: int = 2) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Positions of which some are equal, and some are missing."""
    generator = np.random.default_rng(seed)
    positions = generator.normal(size=(count, dimensions))
    positions[generator.random(count) < 0.1] = np.nan
    if seed % 2:
        positions = np.round(positions, 1)
    return positions


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("count", [1, 2, 64, 65, 300])
def test_the_nearest_distances_are_those_over_all_pairs(count: int, seed: int) -> None:
    positions = scattered(count, seed, 2 + seed % 2)
    found = nearest_distances(positions)
    for row in range(count):
        others = np.delete(positions, row, 0)
        distances = lengths(others - positions[row])
        assert found[row] == np.min(distances[np.isfinite(distances)], initial=np.inf)


@pytest.mark.parametrize("seed", range(20))
def test_the_closest_pair_is_the_one_with_the_least_distance(seed: int) -> None:
    positions = scattered(200, seed)
    generator = np.random.default_rng(seed)
    first = np.flatnonzero(generator.random(200) < 0.5)
    second = np.flatnonzero(generator.random(200) < (0.5 if seed % 3 else 0.01))
    pairs = [
        (lengths(positions[[a]] - positions[[b]])[0], min(a, b), max(a, b))
        for a in first.tolist()
        for b in second.tolist()
        if a != b and np.isfinite(positions[[a, b]]).all()
    ]
    assert closest_pair(positions, first, second) == min(pairs, default=(np.inf, -1, -1))


@pytest.mark.parametrize("count", [2, 50, 200])
def test_the_closest_pair_of_bodies_that_move_enter_and_leave_is_the_one_with_the_least_distance(count: int) -> None:
    generator = np.random.default_rng(count)
    positions, find = generator.normal(size=(count, 2)), ClosestPair()
    for step in range(200):
        positions = positions + generator.normal(scale=0.02 if step % 50 else 1.0, size=(count, 2))
        given = positions.copy()
        given[: (step // 30) % 3] = np.nan
        every = np.arange(count)
        assert find(given) == closest_pair(given, every, every)


SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "crowd",
    "run": {"duration": 4.0},
    "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
    "agents": {
        "robot": {
            "count": 40,
            "model": {"use": "single-integrator"},
            "state": [{"uniform": [-9, 9]}, {"uniform": [-9, 9]}],
            "knowledge": {"goal": [{"uniform": [-9, 9]}, {"uniform": [-9, 9]}]},
            "components": {"steer": {"use": "control.go-to-goal", "with": {"speed": 2.0}}},
        },
        "guest": {
            "count": 3,
            "model": {"use": "single-integrator"},
            "state": [[0, 0], [1, 0], [2, 0]],
            "present": {"from": 1.0, "until": 3.0},
        },
    },
}


def ran(
    folder: Path, stated: dict[str, Any], scenario: dict[str, Any] = SCENARIO
) -> tuple[Outcome, list[tuple[float, frozenset[str], str]]]:
    """The outcome of a specification, and instants, agents and predicates that decided violations."""
    (folder / "crowd.yaml").write_text(yaml.safe_dump({**scenario, "specifications": {"apart": stated}}))
    outcome = execute(build(folder / "crowd.yaml"), folder / "crowd.mcap").specifications[0]
    events = [each for each in open_log(folder / "crowd.mcap").events() if each.name == "violated"]
    return outcome, sorted((e.data["instant"], frozenset(e.data["agents"]), e.data["predicate"]) for e in events)


@pytest.mark.parametrize("pairs", ["robot", [["robot", "guest"]], [["robot", "robot"], ["robot.3", "guest"]]])
@pytest.mark.parametrize(
    "formula",
    [
        "always distance > 0.05",
        "always (time > 2 implies distance - 0.5 > 0)",
        "always not distance / 2 < 0.01",
        "not eventually distance < 0.3 and always 2 * distance >= 0.02",
    ],
)
def test_the_verdict_is_that_of_a_monitor_for_each_pair(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pairs: Any, formula: str
) -> None:
    stated = {"pairs": pairs, "formula": formula}
    single, violations = ran(tmp_path, stated)
    monkeypatch.setattr(specifications, "MOST_PAIRS", 10)
    closest, violation = ran(tmp_path, stated)
    assert sum(closest.counts.values()) == 1 < sum(single.counts.values())
    assert (closest.verdict, closest.robustness) == (single.verdict, single.robustness)
    # The pair that is the first to violate the formula is named.
    assert violation == [] == violations or violation[0] in [each for each in violations if each[0] == violations[0][0]]


@pytest.mark.parametrize("count", [40, 90])
def test_the_closest_of_all_agents_is_found_by_what_the_world_knows_of_their_proximity(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    robot = SCENARIO["agents"]["robot"]
    components = {**robot["components"], "see": {"use": "perception.range", "with": {"range": 2.0}}}
    present = {"present": {"from": 1.0, "until": 3.0}, "count": count // 3}
    scenario = {**SCENARIO, "agents": {"robot": {**robot, "count": count, "components": components}}}
    stated = {"pairs": "robot", "formula": "always distance > 0.01"}
    some_leave = {**scenario, "agents": {"robot": {**scenario["agents"]["robot"], **present}}}
    for each in (scenario, some_leave):
        monkeypatch.setattr(specifications, "MOST_PAIRS", 10_000)
        single, violations = ran(tmp_path, stated, each)
        monkeypatch.setattr(specifications, "MOST_PAIRS", 10)
        closest, violation = ran(tmp_path, stated, each)
        assert sum(closest.counts.values()) == 1 < sum(single.counts.values())
        assert (closest.verdict, closest.robustness) == (single.verdict, single.robustness)
        assert violation == [] == violations or violation[0][0] == violations[0][0]


@pytest.mark.parametrize(
    "formula",
    [
        "always[0, 5] (distance > 1 and historically[0, 1] distance >= 0.5)",
        "next 1 < distance",
        "always not (distance < 1 or distance + time < 2)",
        "not once (distance < 1)",
        "(eventually time > 3) and always min(distance, 5) > 0.1",
        "always (time < 3 or distance > 1)",
        "always -distance < -0.6",
    ],
)
def test_a_formula_of_minima_over_what_grows_with_the_distance_is_accepted(formula: str) -> None:
    check_least(parse(formula, PAIR_UNITS, ARGUMENTS))


@pytest.mark.parametrize(
    ("formula", "wrong"),
    [
        ("eventually distance > 1", "eventually distance > 1"),
        ("always distance < 9", "distance < 9"),
        ("always (distance > 1 or distance > time)", "distance > 1 or distance > time"),
        ("always closing_speed < 1", "closing_speed < 1"),
        ("always (distance < 1 implies distance > 2)", "distance < 1 implies distance > 2"),
        ("always distance != 1", "distance != 1"),
        ("distance > 1 until time > 3", "distance > 1 until time > 3"),
        ("always not 0 < distance < 1", "0 < distance < 1"),
        ("always distance * distance > 1", "distance * distance > 1"),
        ("always 0 < distance < 1", "0 < distance < 1"),
    ],
)
def test_any_other_formula_is_refused_with_its_span(formula: str, wrong: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        check_least(parse(formula, PAIR_UNITS, ARGUMENTS))
    assert formula[caught.value.start : caught.value.end].strip("()") == wrong


def test_the_refusal_of_a_definition_is_located_where_the_formula_uses_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(specifications, "MOST_PAIRS", 10)
    with pytest.raises(ScenarioError, match="only the closest is monitored") as caught:
        ran(tmp_path, {"pairs": "robot", "where": {"far": "distance > 9"}, "formula": "always not far"})
    assert "always not far" in str(caught.value)
