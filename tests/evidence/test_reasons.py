"""The reason of a robustness reproduces the number: re-evaluating the predicate at the instant gives it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from formulas import random_text

from symaware_cli import load
from symaware_cli.log.reader import open_log
from symaware_cli.specification.expression import Expression

PREDICATES = ("x > 0.43", "x < 0.77", "y - x > -0.31", "x * x > 0.19", "norm(state) < 1.03", "y >= 0.2")


def scenario(folder: Path, generator: np.random.Generator, formulas: int) -> Path:
    """Three moving agents; one enters late and one leaves early."""
    specifications: dict[str, dict[str, Any]] = {
        f"s{number}": {"each": "r", "formula": random_text(generator, int(generator.integers(1, 5)), PREDICATES)}
        for number in range(formulas)
    }
    for number in range(0, formulas, 3):
        specifications[f"s{number}"]["interval"] = False
    document = {
        "symaware": 1,
        "name": "reasons",
        "run": {"duration": 1.5},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "specifications": specifications,
        "agents": {
            "r": {
                "count": 3,
                "model": {"use": "single-integrator", "with": {"max_speed": 1.0}},
                "state": [[0.0, 0.3], [0.9, 0.0], [0.5, -0.5]],
                "present": [{}, {"from": 0.3}, {"until": 0.9}],
                "knowledge": {"goal": [[2.0, 0.0], [-1.0, 1.0], [0.5, 3.0]]},
                "components": {
                    "sense": {"use": "perception.self"},
                    "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0}},
                },
            }
        },
    }
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def check(folder: Path, seed: int, formulas: int) -> int:
    """Compare the reasons of a run and its log with the recorded states; return the number of those with a value."""
    result = load(scenario(folder, np.random.default_rng(seed), formulas)).run(output=folder / "log.mcap")
    log = open_log(folder / "log.mcap")
    assert log.outcomes == result.summary.specifications
    states = log.series("r", "world")
    compared = 0
    for outcome in result.summary.specifications:
        if outcome.robustness is None or " by " not in outcome.reason:
            continue
        compared += 1
        assert len(outcome.agents) == 1
        row = int(outcome.agents[0].removeprefix("r."))
        assert outcome.time is not None
        place = int(np.flatnonzero(states.times == round(outcome.time * 1e9))[0])
        state = states.values[place, row]
        predicate, _, rest = outcome.reason.removeprefix("`").partition("` ")
        margin = float(rest.split(" by ")[1].split(" at ")[0])
        assert abs(outcome.robustness) == pytest.approx(margin, rel=1e-5)
        values = {"x": state[0], "y": state[1], "state": state}
        assert Expression(predicate, list(values)).holds(values.__getitem__) == rest.startswith("holds")
        sides = predicate.replace("<=", "<").replace(">=", "<").replace(">", "<").split("<")
        left, right = (float(Expression(each, list(values)).value(values.__getitem__)) for each in sides)
        assert abs(left - right) == pytest.approx(margin, rel=1e-5, abs=1e-6)
    return compared


def test_the_reason_of_an_outcome_reproduces_its_robustness(tmp_path: Path) -> None:
    assert check(tmp_path, 0, 24) > 8


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 25))
def test_the_reasons_of_hundreds_of_outcomes_reproduce_their_robustness(tmp_path: Path, seed: int) -> None:
    assert check(tmp_path, seed, 60) > 15
