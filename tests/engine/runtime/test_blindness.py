"""Agents whose perception fails, among others whose perception goes on."""

from typing import Any

import numpy as np
import pytest
from faulting import fault
from simulating import STEP, Team, present, simulation, untyped

from symaware_cli import ComponentSelection
from symaware_cli.engine.components.communication.inbox import Inbox
from symaware_cli.engine.components.communication.state import StateSender
from symaware_cli.engine.components.perception import OmniscientPerception
from symaware_cli.engine.components.perception_range import RangePerception
from symaware_cli.engine.faults.blind import Blind
from symaware_cli.engine.faults.measurement_fault import Bias
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.run import run
from symaware_cli.engine.runtime.timing import Timing


def known(components: Any, **others: Any) -> Any:
    """Of whom the first of two agents is aware in each step, and where the second believes the first to be."""
    ready = simulation({"pair": Team({"see": OmniscientPerception, **components}, count=2), **others})
    group, entry, frames = ready.groups[0], ready.entries[0], []

    def look() -> None:
        near = group.others(100.0)
        frames.append((near.others[near.observers == 0].tolist(), near.positions[near.observers == 1][0, 0]))

    ready.events.subscribe("iterated", lambda event: look())
    group.control_input = [[1.0, 0.0]] * 2
    fog = fault(Blind, at=5, lasting=10, components=[ComponentSelection(entry, [0])])
    summary = run(ready, 20, options=RunOptions(faults=[fog]))
    assert summary.status == "finished", summary.failure
    return [frame[0] for frame in frames[:20]], [frame[1] for frame in frames[:20]]


def test_an_agent_that_is_not_blinded_sees_the_present_positions() -> None:
    aware, positions = known({})
    assert aware == [*[[1]] * 5, *[[]] * 10, *[[1]] * 5]
    assert positions == sorted(set(positions))


def test_earlier_detections_are_removed_at_once_also_without_a_turn_of_the_sensor() -> None:
    ready = simulation({"pair": Team({"see": OmniscientPerception}, 2, timings={"see": Timing(period=10 * STEP)})})
    group, found = ready.groups[0], []
    ready.events.subscribe("iterated", lambda event: found.append(len(group.others(100.0).others)))
    fog = fault(Blind, at=5, lasting=2, components=[ComponentSelection(ready.entries[0], [0])])
    summary = run(ready, 12, options=RunOptions(faults=[fog]))
    assert summary.status == "finished", summary.failure
    assert found == [2, 2, 2, 2, 2, 1, 1, 1, 1, 1, 2, 2]


@pytest.mark.parametrize("blind", [True, False])
def test_wrong_measurements_reach_estimators(blind: Any) -> None:
    """The observation, which they correct their beliefs with, is that of the sensor with its fault."""
    parameters = RangePerception.Parameters(range=9.0)
    ready = simulation({"pair": Team({"see": lambda: RangePerception(parameters)}, 2)})
    group, entry, found = ready.groups[0], ready.entries[0], []

    def look(event: Any) -> None:
        observation = group.awareness.observation
        assert observation is not None
        wrong = present(observation.state) - ready.environment.state(group)
        found.append((wrong.tolist(), len(observation.tracks)))

    ready.events.subscribe("iterated", look)
    ones = [ComponentSelection(entry, [1])]
    error = {"bias": np.array([0.0, 0.5]), "deviation": np.zeros(2)}
    kind, written, resolved = (Blind, "*", {}) if blind else (Bias, {"of": "*", "state": [0.0, 0.5]}, error)
    bad = fault(untyped(kind), written, 2, 2, components=ones, **untyped(resolved))
    run(ready, 6, options=RunOptions(faults=[bad]))
    sound, faulty = ([[0, 0], [0, 0]], 2), (([[0, 0], [0, 0]], 1) if blind else ([[0, 0], [0, 0.5]], 2))
    assert found[:6] == [sound, sound, faulty, faulty, sound, sound]


def test_a_blinded_agent_still_receives_messages() -> None:
    aware, _ = known({"hear": Inbox}, speaker=Team({"tell": StateSender}))
    assert aware[4:7] == [[1, 2], [2], [2]]
    assert aware[15] == [1, 2]
