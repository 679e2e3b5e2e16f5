"""The control inputs that a log calls applied are those that moved the agents, and the world alone says which."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from simulating import untyped

from symaware_cli import Log, Series, open_log
from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

MODELS = {
    "single-integrator": {"use": "single-integrator", "with": {"max_speed": 0.8}},
    "double-integrator": {"use": "double-integrator", "with": {"max_acceleration": 0.5}},
    "unicycle": {"use": "unicycle", "with": {"max_speed": 0.7, "max_turn_rate": 1.0}},
}
WIDTH = {"single-integrator": 2, "double-integrator": 4, "unicycle": 3}


def document(
    model: str,
    mode: str = "synchronous",
    steer: Mapping[str, Any] | None = None,
    faults: Mapping[str, Any] | None = None,
    environment: Mapping[str, Any] | None = None,
    time_step: float = 0.2,
) -> dict[str, Any]:
    return {
        "symaware": 1,
        "name": "applied",
        "seed": 4,
        "run": {"mode": mode, "duration": 3.0},
        "environment": environment or {"use": "kinematic", "with": {"time_step": time_step}},
        "agents": {
            "robot": {
                "count": 3,
                "model": MODELS[model],
                "state": [[0.0, float(row), *[0.0] * (WIDTH[model] - 2)] for row in range(3)],
                "knowledge": {"goal": [[5, 3], [5, -4], [-5, 2]]},
                "components": {
                    # What is believed changes with each turn, and what is asked for with it.
                    "sense": {"use": "perception.range", "period": 0.05, "with": {"range": 5, "self_noise": 0.5}},
                    "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0}, **(steer or {})},
                },
            }
        },
        "faults": faults or {},
    }


def recorded(
    tmp_path: Path, content: Mapping[str, Any], watch: Callable[[Simulation], object] | None = None
) -> tuple[NoisyModel, Log]:
    path = tmp_path / "applied.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    built = build(path)
    if watch:
        built.simulation.events.subscribe("stepped", lambda event: watch(built.simulation))
    summary = execute(built, tmp_path / "applied.mcap")
    assert summary.status == "finished", summary.failure
    return untyped(built.simulation.groups[0].model), open_log(tmp_path / "applied.mcap")


def at(series: Series, times: NDArray[np.int64]) -> NDArray[np.float64]:
    """The values of a series at some instants, held from the last one before."""
    return series.values[np.searchsorted(series.times, times, side="right") - 1]


spans = st.fixed_dictionaries({"at": st.sampled_from([0.3, 0.5, 1.0, 1.15]), "for": st.sampled_from([0.2, 0.45, 1.0])})
kinds = st.sampled_from(
    [
        {"stop": "robot.1"},
        {"freeze": "robot.0.steer"},
        {"slow": {"of": "robot.steer", "latency": 0.25}},
        {"bias": {"of": "robot.2.sense", "state": None}},
        {"restart": "robot.steer"},
    ]
)
timings = st.fixed_dictionaries(
    {},
    optional={
        "period": st.sampled_from([0.05, 0.15, 0.2, 0.35]),
        "latency": st.sampled_from([0.03, 0.1, 0.3]),
        "offset": st.sampled_from([0.0, 0.1]),
    },
)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    model=st.sampled_from(sorted(MODELS)),
    mode=st.sampled_from(["synchronous", "asynchronous"]),
    steer=timings,
    faults=st.lists(st.tuples(spans, kinds), max_size=3),
)
def test_integrating_the_logged_inputs_gives_the_logged_states(
    tmp_path: Path, model: str, mode: str, steer: dict[str, Any], faults: list[tuple[dict[str, float], dict[str, Any]]]
) -> None:
    asked = {}
    for number, (span, kind) in enumerate(faults):
        if "bias" in kind:
            kind = {"bias": {**kind["bias"], "state": [0.5] * WIDTH[model]}}
        if "restart" in kind:
            span = {"at": span["at"]}
        asked[f"fault{number}"] = {**span, **kind}
    if "period" not in steer:
        steer = {key: value for key, value in steer.items() if key != "offset"}
    dynamics, log = recorded(tmp_path, document(model, mode, steer, asked))
    truth, inputs = log.series("robot", "world"), log.series("robot", "applied_control")
    assert len(truth.times) == 16
    assert inputs.times[0] == truth.times[1], "nothing is applied before the world moves"
    state = truth.values[0]
    for time, expected, given_input in zip(truth.times[1:], truth.values[1:], at(inputs, truth.times[1:]), strict=True):
        state = dynamics.exact_step(state, given_input, 0.2)
        np.testing.assert_array_equal(state, expected, err_msg=f"at {time} ns")


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
@pytest.mark.parametrize(
    "environment",
    [
        {"use": "kinematic", "with": {"time_step": 0.2}},
        {"use": "pymunk", "with": {"time_step": 0.2}},
        {"use": "pybullet", "with": {"time_step": 0.2}},
    ],
    ids=lambda each: each["use"],
)
def test_every_world_has_its_word_on_what_it_applied(tmp_path: Path, mode: str, environment: dict[str, Any]) -> None:
    pytest.importorskip(environment["use"]) if environment["use"] != "kinematic" else None
    told = []
    faults = {"dead": {"at": 1.0, "for": 0.5, "stop": "robot.1"}}
    content = document("unicycle", mode, {"period": 0.05, "latency": 0.03}, faults, environment)
    _, log = recorded(
        tmp_path,
        content,
        lambda simulation: told.append(simulation.environment.applied_input(simulation.groups[0])),
    )
    inputs = log.series("robot", "applied_control")
    times = np.arange(1, len(told) + 1) * 200_000_000
    np.testing.assert_array_equal(at(inputs, times), told)
    assert set(inputs.times.tolist()) <= set(times.tolist())
    assert (inputs.values[..., 0] <= 0.7).all()
    requested = log.series("robot", "requested_control")
    assert (requested.values[..., 0] > 0.7).any()
    if mode == "asynchronous":
        assert len(requested.times) > 2 * len(inputs.times)


def test_an_agent_that_stops_coasts_as_the_world_lets_it(tmp_path: Path) -> None:
    _, log = recorded(tmp_path, document("single-integrator", faults={"dead": {"at": 1.0, "stop": "robot.1"}}))
    inputs = log.series("robot.1", "applied_control")
    assert not inputs.values[inputs.times > 1_000_000_000].any()
    assert (np.linalg.norm(inputs.values[inputs.times <= 1_000_000_000], axis=1) > 0.5).all()


@pytest.mark.parametrize(
    ("omitted", "there"), [("control", set()), ("world", {"/agents/robot/control", "/world/robot/control"})]
)
def test_omitted_channels_are_not_recorded(tmp_path: Path, omitted: str, there: set[str]) -> None:
    content = {**document("unicycle"), "recording": {"omit": [omitted]}}
    _, log = recorded(tmp_path, content)
    assert {topic for topic in log.channels if topic.endswith("/control")} == there
