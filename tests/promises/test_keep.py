"""The fault `keep`: agents do not leave the region in which they promised to stay, and else move as they do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from promising import promising

import symaware_cli as sa
from symaware_cli.geometry import Array

KEEP: Mapping[str, Any] = {"at": 0.0, "keep": {"promise": "stay"}}

#: Models with the start of Adam, who drives along the x axis; he would cross the line x = 0.
MODELS: Mapping[str, tuple[Any, list[float], list[float]]] = {
    "velocity": ({"use": "single-integrator"}, [-0.5, 0.0], [0.8, 0.3]),
    "noise": ({"use": "single-integrator", "with": {"process_noise": 0.2}}, [-0.5, 0.0], [0.8, 0.3]),
    "inertia": ({"use": "double-integrator"}, [-0.5, 0.0, 0.8, 0.3], [0.1, 0.0]),
    "heading": ({"use": "unicycle"}, [-0.5, 0.0, 0.3], [0.8, 0.0]),
}


def drives(model: str = "velocity", faults: Mapping[str, Any] | None = None, **changes: Any) -> dict[str, Any]:
    content = promising()
    use, state, inputs = MODELS[model]
    adam = content["agents"]["adam"]
    adam["model"], adam["state"] = use, state
    adam["components"]["drive"]["with"]["inputs"][0]["input"] = inputs
    return {**content, "faults": dict(faults or {}), **changes}


def moved(content: Mapping[str, Any], *agents: str) -> Array:
    """Return the true states of agents, by default of Adam, at the beginning and after each step."""
    with sa.scenario(dict(content)).start() as simulation:
        found = []
        while True:
            found.append(np.concatenate([np.ravel(simulation.state(each)) for each in agents or ("adam",)]))
            if simulation.done:
                return np.array(found)
            simulation.step()


@pytest.mark.parametrize("model", MODELS)
def test_a_promise_is_kept_by_every_model_and_nothing_changes_before_it_would_be_broken(model: str) -> None:
    without, found = moved(drives(model)), moved(drives(model, {"k": KEEP}))
    first = int(np.flatnonzero(without[:, 0] > 0.0)[0])
    assert np.array_equal(found[:first], without[:first])
    assert found[:, 0].max() <= 0.0
    assert found[first:, 0].min() > -0.25, "it stays at the edge"


def test_an_agent_slides_along_the_edge_with_the_velocity_of_its_motion() -> None:
    without, found = moved(drives()), moved(drives(faults={"k": KEEP}))
    assert np.allclose(found[:, 1], without[:, 1], atol=1e-5), "what leads along the edge stays"
    with_inertia = moved(drives("inertia", {"k": KEEP}))
    assert with_inertia[-1, 2] == pytest.approx(0.0, abs=1e-5)
    assert with_inertia[-1, 3] == pytest.approx(0.3)
    with sa.scenario(drives(faults={"k": KEEP})).start() as simulation:
        simulation.step(15)
        environment = simulation._simulation.environment
        assert environment.snapshot().velocities[0] == pytest.approx([0.0, 0.3], abs=1e-5), "others see it so"
        assert np.ravel(simulation.control("adam")) == pytest.approx([0.8, 0.3]), "what it requests stays"


def test_a_promise_is_kept_for_a_while_and_then_it_is_the_agents_own() -> None:
    found = moved(drives(faults={"k": {**KEEP, "for": 1.2}}))
    assert found[:13, 0].max() <= 0.0
    assert found[-1, 0] > 0.3


def test_an_agent_outside_is_not_held_back_until_it_is_inside() -> None:
    content = drives(faults={"k": KEEP})
    content["agents"]["adam"]["state"] = [0.5, 0.0]
    inputs = [{"time": 0.0, "input": [-0.8, 0.0]}, {"time": 1.0, "input": [0.8, 0.0]}]
    content["agents"]["adam"]["components"]["drive"]["with"]["inputs"] = inputs
    found = moved(content)[:, 0]
    assert found[:11] == pytest.approx(0.5 - 0.08 * np.arange(11))
    assert found[-1] == pytest.approx(0.0, abs=1e-6)
    content["faults"]["away"] = {"at": 1.5, "place": {"of": "adam", "state": [0.2, 0.0]}}
    assert moved(content)[-1, 0] > 0.5, "what moves it suddenly is no step of its own"


def test_several_promises_of_an_agent_are_kept_at_once() -> None:
    content = drives(faults={"k": KEEP, "l": {"at": 0.0, "keep": {"promise": "low", "of": "adam"}}})
    content["regions"]["wedge"] = {"polygon": [[0.3, -2.0], [-0.6, 0.3], [-6.0, 0.3], [-6.0, -2.0]]}
    content["promises"]["low"] = {"of": "adam", "to": "bob", "formula": "always inside(position, wedge)"}
    summary = sa.scenario(content).run(record=False).summary
    assert {each.name: each.verdict for each in summary.specifications} == {"stay": "satisfied", "low": "satisfied"}


def test_of_several_agents_that_promise_some_may_keep_it() -> None:
    content = drives(faults={"k": {"at": 0.0, "keep": {"promise": "stay", "of": "adam.1"}}})
    content["agents"]["adam"] |= {"count": 2, "state": [[-0.5, 2.0], [-0.5, -2.0]]}
    found = moved(content, "adam.0", "adam.1")
    assert found[-1, 0] > 0.5
    assert found[-1, 2] == pytest.approx(0.0, abs=1e-6)


def test_a_body_in_a_physics_world_keeps_its_promise() -> None:
    content = drives("inertia", {"k": KEEP}, environment={"use": "pymunk", "with": {"time_step": 0.1}})
    found = moved(content)
    assert found[-1, 0] == pytest.approx(0.0, abs=1e-2)
    assert found[:, 0].max() <= 0.0


@pytest.mark.parametrize(
    ("keep", "place", "said"),
    [
        ({"promise": "sty"}, "promise", "there is no promise `sty`"),
        ({"promise": "stay", "of": "bob"}, "of", "`bob` did not make the promise `stay`"),
        ({"promise": "stay", "of": "eve"}, "of", "there is no agent"),
    ],
)
def test_an_unkeepable_promise_is_refused_at_its_place(keep: dict[str, Any], place: str, said: str) -> None:
    with pytest.raises(sa.ScenarioError) as refused:
        sa.scenario(drives(faults={"k": {"at": 0.0, "keep": keep}}))
    problems = {each.path: each.message for each in refused.value.problems}
    assert said in problems[f"faults.k.keep.{place}"]
