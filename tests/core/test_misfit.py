"""A value of `_compute` that `_update` cannot use is reported in plain words, in both modes."""

import re
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import STEP, Team, present, simulate, untyped

from symaware_cli import (
    CommunicationSender,
    Controller,
    PerceptionSystem,
    RiskEstimator,
    TimeSeries,
    UncertaintyEstimator,
)
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.timing import Timing
from symaware_cli.world.probability_distribution import always

CONTROL = r"a controller returns its control input, 2 numbers \(velocity_x, velocity_y\), and its intent, a TimeSeries"
GOOD = np.zeros(2)
WRONG = {
    "nothing": (Controller, None, r"`_compute` returned nothing \(None\): " + CONTROL),
    "no intent": (Controller, GOOD, r"returned an array of shape \(2,\): " + CONTROL),
    "a list": (Controller, [GOOD, GOOD], "returned a list: " + CONTROL),
    "three": (Controller, (GOOD, TimeSeries(), 1), r"returned \(ndarray, TimeSeries, int\): " + CONTROL),
    "None for the intent": (Controller, (GOOD, None), r"returned \(ndarray, NoneType\): " + CONTROL),
    "None for the input": (Controller, (None, TimeSeries()), "is no vector, expected real numbers, not None: "),
    "too long": (Controller, (np.zeros(3), TimeSeries()), r"a control input of shape \(3,\): " + CONTROL),
    "complex": (Controller, (np.array([1j, 0]), TimeSeries()), "complex numbers, whose imaginary part would be lost"),
    "text": (Controller, (["1", "2"], TimeSeries()), "expected real numbers, not text"),
    "no states": (PerceptionSystem, None, r"returned nothing \(None\): a perception returns states by id"),
    "a state": (PerceptionSystem, GOOD, "a perception returns states by id"),
    "no risk": (RiskEstimator, None, r"returned nothing \(None\): a risk estimator returns a TimeSeries"),
    "a number": (RiskEstimator, 0.5, "returned a float: a risk estimator returns a TimeSeries"),
    "no uncertainty": (UncertaintyEstimator, None, "an uncertainty estimator returns a TimeSeries"),
    "no messages": (CommunicationSender, None, "a sender returns the messages to send, a list of Message"),
    "a text": (CommunicationSender, ["hello"], "a sender returns the messages to send, a list of Message"),
}
WAYS = {
    "synchronous": (Timing(), RunOptions()),
    "with a latency": (Timing(latency=always(STEP / 1e9)), RunOptions()),
    "asynchronous": (Timing(period=STEP), RunOptions(mode="asynchronous")),
}


def failure(kind: Any, value: Any, timing: Timing, options: RunOptions) -> str:
    class Wrong(kind):  # type: ignore[misc] # a class of each family
        def _compute(self) -> Any:
            return value

    summary = simulate({"robot": Team({"it": Wrong}, timings={"it": timing})}, 4, options=options)
    assert summary.status == "failed"
    assert summary.failure is not None
    return summary.failure


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_value_is_reported_with_the_expected_one(what: str, way: str) -> None:
    kind, value, expected = WRONG[what]
    told = failure(kind, value, *WAYS[way])
    assert re.search(expected, told), told
    assert told.startswith("agents.robot.it (test.it) failed at ")
    assert "unpack" not in told


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("asynchronous", [False, True])
def test_a_wrong_value_for_the_papers_update_is_reported_in_the_same_way(way: str, asynchronous: bool) -> None:
    class Paper(Controller):
        def _compute(self) -> Any:
            return None

        def _update(self, value: Any) -> None:
            control_input, intent = value
            self._agent.model.control_input = control_input
            self._agent.self_awareness.intent = intent

    class Waits(Paper):
        async def _async_compute(self) -> Any:
            return self._compute()

    timing, options = WAYS[way]
    team = Team({"it": Waits if asynchronous else Paper}, timings={"it": timing})
    told = simulate({"robot": team}, 4, options=options).failure
    assert "returned nothing (None): a controller returns its control input" in present(told)


def test_a_failure_of_an_overridden_update_is_raised_unchanged() -> None:
    class Own(Controller):
        def _compute(self) -> tuple[NDArray[np.float64], TimeSeries, str]:
            return GOOD, TimeSeries(), "more"

        def _update(self, value: tuple[NDArray[np.float64], TimeSeries, str]) -> None:
            raise ValueError("of its own")

    assert "ValueError: of its own" in present(simulate({"robot": Team({"it": Own})}, 1).failure)


def test_a_failure_of_compute_is_not_blamed_on_the_value_before() -> None:
    class Second(Controller):
        def _compute(self) -> tuple[NDArray[np.float64], TimeSeries, str]:
            if self._agent.row:
                _first, _second = untyped(None)
            return GOOD, TimeSeries(), "more"

        def _update(self, value: tuple[NDArray[np.float64], TimeSeries, str]) -> None:
            super()._update(value[:2])

    told = simulate({"robot": Team({"it": Second}, count=2)}, 1).failure
    assert told is not None
    assert told.startswith("agents.robot.1.it")
    assert "cannot unpack" in told
