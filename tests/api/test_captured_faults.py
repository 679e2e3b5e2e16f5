"""States of runs with faults: captured before, during and after them, restored in the same simulation or another."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import symaware_cli as sa
from symaware_cli.language.catalogue import Catalogue

STEPS = 18
#: The first fault begins at step 4, the second at step 6; those with an end last for four steps.
BEFORE, DURING, OVERLAPPING, AFTER = (0, 3), (5,), (7,), (9, 12)

#: Two faults of each kind. Whatever they put into the run must not be the scenario's own.
KINDS: Mapping[str, Sequence[Any]] = {
    "stop": ["a", "b"],
    "restart": ["a.steer", "b.steer"],
    "freeze": ["a.steer", "b.steer"],
    "blind": ["a.see", "b.see"],
    "slow": [{"of": "a.steer", "latency": 0.15}, {"of": "b.steer", "latency": {"uniform": [0.1, 0.3]}}],
    "bias": [{"of": "a.see", "state": [0.5, 0.0]}, {"of": "b.see", "state": [0.0, 0.4]}],
    "noise": [{"of": "a.see", "deviation": [0.2, 0.0]}, {"of": "b.see", "deviation": [0.0, 0.3]}],
    "drop": [{"sender": "a", "probability": 0.5}, {"sender": "b", "probability": 0.7}],
    "delay": [{"sender": "a", "by": 0.15}, {"sender": "b", "by": 0.25}],
    "cut": [{"between": ["a", "b"]}, {"between": ["b", "c"]}],
    "degrade": [{"sender": "a", "loss": 0.4}, {"sender": "b", "delay": 0.15, "bandwidth": 2000}],
    "partition": [[["a"], ["b", "c"]], [["b"], ["a", "c"]]],
    "push": [{"of": "a", "by": [0.2, 0.1]}, {"of": "b", "by": [-0.1, 0.3]}],
    "place": [{"of": "a", "state": [1.0, 1.0]}, {"of": "b", "state": [2.0, -1.0]}],
    "inform": [{"of": "a", "knowledge": {"goal": [0.0, 4.0]}}, {"of": "b", "knowledge": {"goal": [1.0, -4.0]}}],
    "reconfigure": [{"of": "a.steer", "with": {"speed": 0.05}}, {"of": "b.steer", "with": {"speed": 0.4}}],
    "replace": [
        {"of": "a.steer", "use": "control.velocity-obstacle", "with": {"speed": 0.5}},
        {"of": "b.steer", "use": "control.velocity-obstacle", "with": {"speed": 0.5}},
    ],
    "restore": ["cut", "cut"],
    "believe": [{"agent": "a", "about": "b"}, {"agent": "b", "about": "c", "truth": False}],
    "deliver": [{"sender": "a"}, {"sender": "b", "placebo": True}],
    "prevent": ["cut", "late"],
    "keep": [{"promise": "near"}, {"promise": "far"}],
}

#: These take effect at one instant.
INSTANTANEOUS = {"restart", "push", "place", "inform", "restore", "prevent"}

CASES = [(kind, lasts) for kind in KINDS for lasts in (False, True) if not (lasts and kind in INSTANTANEOUS)]


def agent(place: int) -> dict[str, Any]:
    """The section of an agent that starts at a place of a row."""
    return {
        "model": {"use": "single-integrator", "with": {"process_noise": 0.05}},
        "state": [float(place), 0.0],
        "knowledge": {"goal": [3.0, 0.5 * place]},
        "components": {
            "inbox": {"use": "communication.inbox"},
            "see": {"use": "perception.range", "with": {"range": 9.0, "position_noise": 0.01}},
            "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0}},
            "tell": {"use": "communication.broadcast"},
        },
    }


def document(kind: str, *, lasts: bool) -> dict[str, Any]:
    """A scenario with two faults of a kind."""
    faults: dict[str, Any] = {
        name: {"at": at, kind: fault} | ({"for": 0.4} if lasts else {})
        for name, at, fault in zip(("one", "two"), (0.4, 0.6), KINDS[kind], strict=True)
    }
    if kind == "prevent":
        faults["late"] = {"at": 0.8, "push": {"of": "b", "by": [0.3, 0.3]}}
    if kind in ("restore", "prevent"):
        faults["cut"] = {"at": 0.2, "cut": {"between": ["a", "b"]}}
    agents = {name: agent(place) for place, name in enumerate("abc")}
    promised: dict[str, Any] = {}
    if kind == "keep":
        agents["c"]["components"]["watch"] = {"use": "promises.monitor"}
        promised["regions"] = {"left": {"box": [-1.0, 0.7, -2.0, 2.0]}, "middle": {"box": [-1.0, 1.6, -2.0, 2.0]}}
        promised["promises"] = {
            name: {"of": of, "to": "c", "formula": f"always inside(position, {region})"}
            for name, of, region in (("near", "a", "left"), ("far", "b", "middle"))
        }
    return {
        "symaware": 1,
        "name": "faults",
        "seed": 3,
        "run": {"duration": STEPS / 10},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "agents": agents,
        "topology": {"use": "complete", "channel": {"delay": 0.1, "jitter": 0.1}},
        "faults": faults,
        **promised,
    }


Told = list[tuple[Any, ...]]


def rest(simulation: sa.SteppedSimulation) -> Told:
    """Everything that happens up to the end."""
    told: Told = []
    while not simulation.done:
        simulation.step()
        told += [(event.time, event.name, event.source, event.text) for event in simulation.events]
        read = (simulation.state, simulation.belief, simulation.control)
        told.append((simulation.now, *(each(name).tobytes() for each in read for name in "abc")))
        told.append(tuple(known(simulation)))
    return told


def known(simulation: sa.SteppedSimulation) -> list[Any]:
    """What each agent knows, and believes of the others."""
    return [
        (
            agent.id,
            [(other, vector.state.tobytes()) for other, vector in agent.awareness_database.items()],
            [(name, np.asarray(value).tolist()) for name, value in agent.self_knowledge.items()],
        )
        for group in simulation._simulation.groups
        for agent in group.agents
    ]


def check(kind: str, *, lasts: bool, steps: Sequence[int], fresh: Sequence[int], folder: Path) -> None:
    (folder / "s.yaml").write_text(yaml.safe_dump(document(kind, lasts=lasts), sort_keys=False))
    scenario = sa.load(folder / "s.yaml")
    states: dict[int, sa.SimulationState] = {}
    whole: dict[int, Told] = {}
    with scenario.start() as simulation:
        for step in steps:
            if step > simulation.steps:
                simulation.step(step - simulation.steps)
            states[step] = simulation.capture()
        told = rest(simulation)
        whole[steps[-1]] = told
        # In the same simulation, backwards and forwards: each restored state has passed faults, or lacks them.
        for step in (*reversed(steps), *steps):
            simulation.restore(states[step])
            again = rest(simulation)
            assert again[-len(told) :] == told, f"the end after a state of step {step}"
            assert whole.setdefault(step, again) == again, f"what follows the state of step {step}"
    for step in fresh:
        with scenario.start() as simulation:
            simulation.restore(sa.SimulationState.from_bytes(states[step].to_bytes()))
            assert rest(simulation) == whole[step], f"what follows the state of step {step} elsewhere"


def test_the_table_has_every_kind_of_fault() -> None:
    assert {*KINDS} == {each.name for each in Catalogue().listings("fault") if each.built_in}


@pytest.mark.parametrize(("kind", "lasts"), CASES)
def test_a_state_captured_before_or_during_a_fault_continues_as_the_run(kind: str, lasts: bool, tmp_path: Path) -> None:
    check(kind, lasts=lasts, steps=(3, 7), fresh=(7,), folder=tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "lasts"), CASES)
def test_a_state_captured_at_any_time_continues_as_the_run(kind: str, lasts: bool, tmp_path: Path) -> None:
    steps = (*BEFORE, *DURING, *OVERLAPPING, *AFTER)
    check(kind, lasts=lasts, steps=steps, fresh=steps, folder=tmp_path)
