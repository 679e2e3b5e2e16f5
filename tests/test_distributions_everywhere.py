"""A distribution is described by the same words, and drawn by the same function, wherever a value may be random."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import scipy.stats
from numpy.typing import NDArray

from symaware_cli.engine.network.channel.channel import Channel
from symaware_cli.engine.network.channel.link_states import LinkStates
from symaware_cli.engine.runtime.supervision import Supervision
from symaware_cli.language.build import Built, build
from symaware_cli.language.problem import Problem, ScenarioError
from symaware_cli.studies.sweep_source import read_sweep
from symaware_cli.world import Turn
from symaware_cli.world.probability_distribution import Distribution

#: How many values are drawn.
MANY = 500

#: Each form with what it is in the literature; none is ever negative, as some of the values are durations.
FORMS: dict[str, tuple[dict[str, Any], Any]] = {
    "uniform": ({"uniform": [0.1, 0.3]}, scipy.stats.uniform(0.1, 0.2)),
    "normal": ({"normal": [0.1, 0.2], "least": 0}, scipy.stats.truncnorm(-0.5, np.inf, 0.1, 0.2)),
    "lognormal": ({"lognormal": [0.1, 0.5]}, scipy.stats.lognorm(0.5, scale=0.1)),
    "loguniform": ({"loguniform": [0.01, 0.4]}, scipy.stats.loguniform(0.01, 0.4)),
    "exponential": ({"exponential": 0.05}, scipy.stats.expon(scale=0.05)),
    "constant": ({"exponential": 0.05, "constant": 0.02}, scipy.stats.expon(0.02, 0.05)),
    "bounds": ({"exponential": 0.5, "greatest": 1.0}, scipy.stats.truncexpon(2, scale=0.5)),
    "choice": ({"choice": [0.1, 0.2], "weights": [1, 3]}, None),
}

Draw = Callable[[Built, Path], NDArray[np.float64]]


def delays(built: Built, _: Path) -> NDArray[np.float64]:
    channel = built.document.topology.channel  # type: ignore[union-attr]
    states = LinkStates(7, [f"robot.{number}" for number in range(MANY + 1)])
    rows, _rest = states.rows(np.zeros(MANY, np.intp), np.arange(1, MANY + 1))
    fates = Channel(channel).carry(states, rows, states.number(rows, 0), 0, np.full(MANY, 100))
    return fates.due / 1e9


def latencies(built: Built, _: Path) -> NDArray[np.float64]:
    entry = next(each for each in built.simulation.entries if each.name == "steer")
    supervision = Supervision(built.simulation, entry, lambda: None)
    return np.array([supervision.latency(0, Turn(number)) for number in range(MANY)]) / 1e9


def slow_latencies(built: Built, _: Path) -> NDArray[np.float64]:
    entry = next(each for each in built.simulation.entries if each.name == "steer")
    supervision = Supervision(built.simulation, entry, lambda: None)
    (fault,) = built.options.faults
    supervision.slow_down([0], fault.duration)  # type: ignore[attr-defined]
    return np.array([supervision.latency(0, Turn(number)) for number in range(MANY)]) / 1e9


def states(built: Built, _: Path) -> NDArray[np.float64]:
    return built.simulation.groups[0].initial_state[:, 1]


def knowledge(built: Built, _: Path) -> NDArray[np.float64]:
    return np.array([each["fact"] for each in built.simulation.groups[0].knowledge])


def samples(_: Built, folder: Path) -> NDArray[np.float64]:
    plan = read_sweep(folder / "sweep.yaml").plan
    return np.array([plan.parameters(number)["run.duration"] for number in range(MANY)])


class Place(NamedTuple):
    """A place of a distribution.

    Attributes:
        path: Where it is written, in the scenario or the sweep.
        draw: Draws values from it.
    """

    path: tuple[str | int, ...]
    draw: Draw


PLACES = {
    "delay": Place(("topology", "channel", "delay"), delays),
    "latency": Place(("agents", "robot", "components", "steer", "latency"), latencies),
    "latency of a fault": Place(("faults", "late", "slow", "latency"), slow_latencies),
    "element of the state": Place(("agents", "robot", "state", 1), states),
    "whole state": Place(("agents", "robot", "state"), states),
    "knowledge": Place(("agents", "robot", "knowledge", "fact"), knowledge),
    "sweep": Place(("over", "run.duration"), samples),
}


def written(folder: Path, place: Place, content: dict[str, Any]) -> Path:
    """Write a scenario and a sweep, one of which has a distribution at a place; return the one that has it."""
    scenario: dict[str, Any] = {
        "symaware": 1,
        "name": "everywhere",
        "run": {"duration": 1.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
        "agents": {
            "robot": {
                "count": MANY if place.draw in (states, knowledge) else 2,
                "model": {"use": "single-integrator"},
                "state": [0.0, 0.0],
                "knowledge": {"goal": [9.0, 0.0], "fact": 0.0},
                "components": {"steer": {"use": "control.go-to-goal", "latency": 0.0}},
            }
        },
        "topology": {"use": "complete", "channel": {"delay": 0.0}},
        "faults": {"late": {"slow": {"of": "robot.steer", "latency": 0.0}, "at": 0.5}},
    }
    sweep: dict[str, Any] = {"symaware-sweep": 1, "scenario": "scenario.yaml", "runs": MANY, "over": {}}
    tree: Any = sweep if place.path[0] == "over" else scenario
    *outer, last = place.path
    for key in outer:
        tree = tree[key]
    tree[last] = content
    (folder / "scenario.yaml").write_text(json.dumps(scenario, indent=1))
    (folder / "sweep.yaml").write_text(json.dumps(sweep, indent=1))
    return folder / ("sweep.yaml" if place.path[0] == "over" else "scenario.yaml")


def drawn(folder: Path, place: Place, content: dict[str, Any]) -> NDArray[np.float64]:
    written(folder, place, content)
    return place.draw(build(folder / "scenario.yaml"), folder)


def problem(folder: Path, place: Place, content: dict[str, Any]) -> Problem:
    file = written(folder, place, content)
    with pytest.raises(ScenarioError) as caught:
        _ = read_sweep(file) if file.name == "sweep.yaml" else build(file)
    (found,) = caught.value.problems
    return found


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_valid_in_every_place_and_gives_its_distribution(form: str, place: str, tmp_path: Path) -> None:
    content, expected = FORMS[form]
    if (form, place) == ("choice", "whole state"):
        content = {"choice": [[0.0, 0.1], [0.0, 0.2]], "weights": [1, 3]}  # which has options that are whole states
    values = drawn(tmp_path, PLACES[place], content)
    assert len(values) == MANY
    if expected is None:
        assert {*values.tolist()} == {0.1, 0.2}
        assert (values == 0.2).mean() == pytest.approx(0.75, abs=0.05)
    else:
        # Kolmogorov and Smirnov; the seeds are fixed, so this never fails by chance.
        assert scipy.stats.kstest(values, expected.cdf).pvalue > 1e-3


@pytest.mark.parametrize("place", PLACES)
def test_every_place_draws_from_the_same_function(place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def halves(self: Any, points: NDArray[np.float64]) -> NDArray[np.float64]:
        assert self.form == "lognormal"
        assert ((points >= 0) & (points < 1)).all()
        return np.where(points < 0.5, 0.25, 0.5)

    monkeypatch.setattr(Distribution, "quantiles", halves)
    values = drawn(tmp_path, PLACES[place], {"lognormal": [0.1, 0.5]})
    assert {*values.tolist()} == {0.25, 0.5}


@pytest.mark.parametrize("place", ["element of the state", "whole state", "knowledge", "sweep"])
def test_only_durations_need_a_normal_distribution_with_a_lower_bound(place: str, tmp_path: Path) -> None:
    values = drawn(tmp_path, PLACES[place], {"normal": [0.1, 0.2]})
    assert scipy.stats.kstest(values, scipy.stats.norm(0.1, 0.2).cdf).pvalue > 1e-3


@pytest.mark.parametrize("place", ["delay", "latency", "latency of a fault"])
@pytest.mark.parametrize(
    ("content", "inner", "said"),
    [
        ({"normal": [0.1, 0.2]}, "normal", "a duration is never negative: `normal` needs a lower bound"),
        ({"normal": [0.1, 0.2], "least": -1}, "", "a duration is never negative, and `normal` may give -1 s"),
        ({"uniform": [-0.1, 0.2]}, "uniform", "a duration is never negative, and `uniform` may give -0.1 s"),
        ({"exponential": 0.1, "constant": -1}, "exponential", "a duration is never negative"),
        ({"choice": [0.1, -0.2]}, "choice", "a duration is never negative, and `choice` may give -0.2 s"),
        ({"choice": [0.1, "long"]}, "choice", "every value of `choice` is a number"),
        ({"uniform": [0.1, 1e10]}, "uniform", "a duration is at most 1e+09 s"),
    ],
)
def test_an_invalid_duration_is_refused_everywhere_in_the_same_way(
    content: dict[str, Any], inner: str, said: str, place: str, tmp_path: Path
) -> None:
    found = problem(tmp_path, PLACES[place], content)
    assert found.span is not None
    assert said in found.message
    if inner:
        assert found.path.endswith(f"latency.{inner}" if "latency" in place else f"delay.{inner}")


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    ("content", "inner", "said"),
    [
        ({"uniform": [0.3, 0.1]}, ".uniform", "the low end 0.3 lies above the high end 0.1"),
        ({"uniform": [0.3]}, ".uniform", "is a list of 1"),
        ({"uniform": ["x", 0.1]}, ".uniform[0]", "is the text `x`"),
        ({"normal": [0.3, -0.1], "least": 0}, ".normal[1]", "is -0.1: a deviation is at least 0"),
        ({"lognormal": [0.3, 11.0]}, ".lognormal[1]", "is 11.0: the deviation of a logarithm is at most 10"),
        ({"loguniform": [0, 0.1]}, ".loguniform", "a logarithm needs numbers greater than 0, not 0"),
        ({"exponential": -0.1}, ".exponential", "is -0.1: the mean or median"),
        ({"choice": []}, ".choice", "is an empty list"),
        ({"choice": [0.1], "weights": [1, 2]}, ".weights", "there are 2 weights for 1 options"),
        ({"uniform": [0.1, 0.3], "least": 0.2}, ".least", "is for distributions without ends"),
        ({"uniform": [0.1, 0.3], "weights": [1]}, ".weights", "weights go with `choice`"),
        ({"normal": [-9, 0.1], "least": 0}, ".least", "excludes nearly all of the distribution"),
    ],
)
def test_an_invalid_distribution_is_refused_everywhere_in_the_same_way(
    content: dict[str, Any], inner: str, said: str, place: str, tmp_path: Path
) -> None:
    found = problem(tmp_path, PLACES[place], content)
    assert found.span is not None
    assert found.path.endswith(inner)
    assert said in found.message


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("content", [{"uniform": [0, 1], "exponential": 1}, {"uniform": [0, 1], "seed": 1}])
def test_keys_that_do_not_go_with_a_form_are_refused(content: dict[str, Any], place: str, tmp_path: Path) -> None:
    found = problem(tmp_path, PLACES[place], content)
    assert found.span is not None
    assert "exactly one of" in f"{found.message} {found.expected}" or "unknown key `seed`" in found.message
