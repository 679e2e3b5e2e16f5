"""Beliefs that a fault makes true, and placebos, in which their errors are drawn anew."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from symaware_cli.engine.runtime.run import run
from symaware_cli.language.build import build
from symaware_cli.language.problem import ScenarioError

SEE = {"use": "perception.range", "with": {"range": 9.0, "position_noise": 0.5, "velocity_noise": 0.2, "dropout": 0.3}}

#: Turns after which the beliefs of a step are compared: of the component of the group, or of its first agent.
STEERING = ("agents.r.steer", "agents.r.0.steer")

Errors = list[dict[tuple[str, str], float | None]]


def scenario(fault: Mapping[str, Any] | None, *, see: Any = None, also: Any = None, self_noise: float = 0.0) -> Any:
    with_ = {**SEE["with"], "self_noise": self_noise}  # type: ignore[dict-item]
    components = {"see": see or {**SEE, "with": with_}, **(also or {}), "steer": {"use": "control.go-to-goal"}}
    group = {"count": 3, "model": {"use": "single-integrator"}, "components": components}
    group |= {"state": {"each": [[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]]}, "knowledge": {"goal": [3.0, 3.0]}}
    tree: dict[str, Any] = {"symaware": 1, "name": "beliefs", "seed": 4, "run": {"duration": 1.2}}
    tree |= {"environment": {"use": "kinematic", "with": {"time_step": 0.1}}, "agents": {"r": group}}
    return {**tree, **({"faults": {"true": fault}} if fault else {})}


def built(tree: Any, folder: Path) -> Any:
    file = folder / "beliefs.yaml"
    file.write_text(yaml.safe_dump(tree, sort_keys=False))
    return build(file)


def errors(tree: Any, folder: Path) -> Errors:
    """The distance of each belief from the truth at the end of the turns of each step, None for no belief."""
    ready = built(tree, folder)
    simulation = ready.simulation
    group, found = simulation.groups[0], []

    def look(event: Any) -> None:
        snapshot, row = simulation.environment.snapshot(), {}
        for agent in group.agents:
            for id in group.ids:
                true = snapshot.motions[id] if id != agent.id else snapshot.states[0][group.ids.index(id)]
                known = agent.awareness_database.get(id)
                row[agent.id, id] = None if known is None else float(np.abs(known.state - true).max())
        found.append(row)

    simulation.events.subscribe("computing", lambda event: look(event) if event.source in STEERING else None)
    summary = run(simulation, ready.steps, options=ready.options)
    assert summary.status == "finished", summary.failure
    return found


def differing(one: Errors, other: Errors) -> set[tuple[str, str]]:
    return {pair for a, b in zip(one, other, strict=True) for pair in a if a[pair] != b[pair]}


def believe(**given: Any) -> dict[str, Any]:
    return {"at": 0.4, "for": 0.5, "believe": {"agent": "r.0", "about": "r.1", **given}}


def test_a_belief_is_true_during_the_fault_and_only_that_one(tmp_path: Path) -> None:
    without, with_ = errors(scenario(None), tmp_path), errors(scenario(believe()), tmp_path)
    inside = [row["r.0", "r.1"] for row in with_[4:9]]
    assert inside == [0.0] * 5
    assert None in [row["r.0", "r.1"] for row in without[4:9]], "a dropout is a wrong belief as well"
    assert differing(without, with_) == {("r.0", "r.1")}
    assert with_[9:] == without[9:]
    assert with_[:4] == without[:4]


def test_an_estimator_is_given_true_measurements_and_its_covariances_are_its_own(tmp_path: Path) -> None:
    also = {"guess": {"use": "uncertainty.gaussian"}}
    ready = built(scenario(believe(), also=also), tmp_path)
    group, found = ready.simulation.groups[0], []
    ready.simulation.events.subscribe("iterated", lambda event: found.append(group.awareness.seen))
    run(ready.simulation, ready.steps, options=ready.options)
    seen = found[7]
    covariances = seen.covariances[(seen.observers == 0) & (seen.others == 1)]
    assert len(covariances) == 1
    assert covariances[0][0, 0] > 0.0
    inside = [row["r.0", "r.1"] for row in errors(scenario(believe(), also=also), tmp_path)[4:9]]
    assert inside == [0.0] * 5


def test_an_agent_may_believe_the_truth_about_itself(tmp_path: Path) -> None:
    found = errors(scenario(believe(about="r.0"), self_noise=0.3), tmp_path)
    assert [row["r.0", "r.0"] == 0.0 for row in found] == [4 <= step < 9 for step in range(len(found))]


def test_beliefs_of_another_instant_are_exact_when_they_are_extrapolated(tmp_path: Path) -> None:
    see = {"use": "perception.range", "with": {"range": 9.0, "position_noise": 0.5, "delay": 0.2}}
    ready = built(scenario(believe(), see=see), tmp_path)
    simulation, found = ready.simulation, []
    group = simulation.groups[0]

    def look(event: Any) -> None:
        tracks, snapshot = group.awareness.tracks.at(simulation.clock.now), simulation.environment.snapshot()
        row = (tracks.observers == 0) & (tracks.others == 1)
        found.append(float(np.abs(tracks.positions[row] - snapshot.positions[1]).max(initial=0.0)))

    simulation.events.subscribe("computing", lambda event: look(event) if event.source in STEERING else None)
    run(simulation, ready.steps, options=ready.options)
    assert max(found[4:9]) < 1e-12 < min(found[9:])


def test_a_placebo_draws_nothing_anew_but_the_errors_of_one_belief(tmp_path: Path) -> None:
    see = {"use": "perception.range", "with": {**SEE["with"], "dropout": 0.0, "self_noise": 0.1}}  # type: ignore[dict-item]
    without = errors(scenario(None, see=see), tmp_path)
    placebo = errors(scenario(believe(truth=False), see=see), tmp_path)
    other = errors(scenario(believe(truth=False, draw=1), see=see), tmp_path)
    assert differing(without[:4], placebo[:4]) == set()
    assert differing(without[4:5], placebo[4:5]) == {("r.0", "r.1")}
    assert differing(placebo[4:5], other[4:5]) == {("r.0", "r.1")}
    assert all(row["r.0", "r.1"] != 0.0 for row in placebo)


def test_a_placebo_of_the_belief_about_oneself_leaves_beliefs_about_others(tmp_path: Path) -> None:
    without = errors(scenario(None, self_noise=0.1), tmp_path)
    placebo = errors(scenario(believe(about="r.0", truth=False), self_noise=0.1), tmp_path)
    assert differing(without[4:5], placebo[4:5]) == {("r.0", "r.0")}


def test_the_intent_is_the_one_that_the_other_agent_holds(tmp_path: Path) -> None:
    talk = {"tell": {"use": "communication.broadcast", "period": 0.5}, "hear": {"use": "communication.inbox"}}
    ready = built(scenario(believe(part="intent"), also=talk), tmp_path)
    simulation, found = ready.simulation, []
    group = simulation.groups[0]

    def look(event: Any) -> None:
        known = group.agents[0].awareness_database.get("r.1")
        told = None if known is None else known["intent"]
        found.append((told, group.agents[1].self_awareness["intent"]))

    simulation.events.subscribe("iterated", look)
    summary = run(simulation, ready.steps, options=ready.options)
    assert summary.status == "finished", summary.failure
    equal = [told == held for told, held in found]
    assert all(equal[4:9])
    assert not all(equal)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"part": "risk"}, "computes its risk from its beliefs"),
        ({"part": "uncertainty"}, "computes its uncertainty from its beliefs"),
        ({"part": "intent", "about": "r.0"}, "knows its own intent"),
        ({"part": "intent", "truth": False}, "there is no placebo"),
        ({"about": "s.1"}, "s.1"),
        ({"agent": "s"}, "`s`"),
    ],
)
def test_a_belief_that_cannot_be_made_true_is_refused_at_its_place(given: Any, said: str, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=said) as caught:
        built(scenario(believe(**given)), tmp_path)
    assert caught.value.problems[0].path.startswith("faults.true.believe.")
