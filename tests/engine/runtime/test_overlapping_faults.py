"""Faults that overlap: what several of them do at once is over when the last of them is."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from faulting import fault
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from simulating import STEP, Team, simulation

from symaware_cli import Component, ComponentSelection, GroupComponent, open_log
from symaware_cli.engine.faults.measurement_fault import Bias
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.run import run
from symaware_cli.engine.runtime.timing import Timing
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

KINDS = {
    "stop": "robot.1",
    "freeze": "robot.1.steer",
    "blind": "robot.*.see",
    "slow": {"of": "robot.steer", "latency": 0.12},
    "slow drawn": {"of": "robot.steer", "latency": {"uniform": [0.02, 0.3]}},
    "cut": {"between": ["robot.0", "robot.2"]},
    "partition": [["robot.0"], ["robot.1", "robot.2"]],
    "drop": {"sender": "robot.0", "receiver": "*", "probability": 1.0},
}


def recorded(
    tmp_path: Path, faults: Mapping[str, Any], mode: str
) -> tuple[list[tuple[str, str, int]], list[tuple[str, int, bytes]]]:
    document = {
        "symaware": 1,
        "name": "overlap",
        "seed": 3,
        "run": {"mode": mode, "duration": 3.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "agents": {
            "robot": {
                "count": 3,
                "model": {"use": "single-integrator"},
                "state": [[0, 0], [0, 1], [0, 2]],
                "knowledge": {"goal": [[5, 0.5], [5, 1], [5, 1.5]]},
                "components": {
                    "see": {"use": "perception.range", "with": {"range": 9.0, "self_noise": 0.05}},
                    "hear": {"use": "communication.inbox"},
                    "tell": {"use": "communication.state"},
                    "steer": {"use": "control.velocity-obstacle", "period": 0.1, "with": {"speed": 1.0}},
                },
            }
        },
        "faults": faults,
    }
    path = tmp_path / "overlap.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    summary = execute(build(path), tmp_path / "overlap.mcap")
    assert summary.status == "finished", summary.failure
    log = open_log(tmp_path / "overlap.mcap")
    said = [(each.name, each.source, each.time) for each in log.events() if not each.name.startswith("fault")]
    topics = log.channels.keys() - {"/timing", "/events", "/messages"}
    return said, [(each.channel.topic, each.time, each.data) for each in log.messages(topics)]


def union(intervals: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Intervals in tenths of a second, joined where they overlap."""
    joined: list[Any] = []
    for start, end in sorted(intervals):
        if joined and start < joined[-1][1]:
            joined[-1] = (joined[-1][0], max(end, joined[-1][1]))
        else:
            joined.append((start, end))
    return joined


def faults_of(kind: str, intervals: Sequence[tuple[int, int]]) -> dict[str, Any]:
    effect = {kind.split()[0]: KINDS[kind]}
    return {
        f"f{number}": {"at": start / 10, "for": (end - start) / 10, **effect}
        for number, (start, end) in enumerate(intervals)
    }


interval = st.tuples(st.integers(1, 18), st.integers(2, 12)).map(lambda each: (each[0], each[0] + each[1]))


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
@pytest.mark.parametrize("kind", sorted(KINDS))
@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(intervals=st.lists(interval, min_size=2, max_size=4))
def test_any_intervals_have_the_effect_of_their_union(
    tmp_path: Path, kind: str, mode: str, intervals: list[tuple[int, int]]
) -> None:
    apart = union(intervals)
    # One that begins in the instant in which another ends is another beginning.
    if any(one[1] == other[0] for one in [*apart, *intervals] for other in [*apart, *intervals]):
        return
    assert recorded(tmp_path, faults_of(kind, intervals), mode) == recorded(tmp_path, faults_of(kind, apart), mode)


@pytest.mark.parametrize("first", [0.10, 0.25])
def test_of_several_latencies_the_longest_counts_as_long_as_it_lasts(tmp_path: Path, first: float) -> None:
    """Whichever began first."""
    second = round(0.35 - first, 2)
    content = {
        "symaware": 1,
        "name": "slow",
        "seed": 1,
        "run": {"mode": "asynchronous", "duration": 6.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "agents": {
            "a": {
                "model": {"use": "single-integrator"},
                "state": [0.0, 0.0],
                "knowledge": {"goal": [50.0, 0.0]},
                "components": {
                    "see": {"use": "perception.self"},
                    "steer": {"use": "control.go-to-goal", "period": 0.5},
                },
            }
        },
        "faults": {
            "one": {"at": 1.0, "for": 2.0, "slow": {"of": "a.steer", "latency": first}},
            "two": {"at": 2.0, "for": 2.0, "slow": {"of": "a.steer", "latency": second}},
        },
    }
    path = tmp_path / "slow.yaml"
    path.write_text(yaml.safe_dump(content))
    execute(build(path), tmp_path / "slow.mcap")
    times = open_log(tmp_path / "slow.mcap").series("a", "requested_control").times / 1e9
    late = {round(time // 0.5 * 0.5, 1): round(time % 0.5, 3) for time in times if time > 0}
    assert [late[each / 2] for each in range(1, 12)] == [
        0,  # at .5 s
        *[first] * 2,
        *[0.25] * 2,
        *[second] * 2,
        *[0] * 4,
    ]


class Feels(Component):
    """Measures its own state, in turns of its own."""

    def _compute(self) -> Any:
        return self.environment.state(self._agent.group)[self._agent.row]

    def _update(self, value: Any) -> None:
        self._agent.self_awareness.state = value


class FeelsAll(GroupComponent):
    """The same for all at once."""

    def _compute(self) -> Any:
        return self.environment.state(self._group)

    def _update(self, value: Any) -> None:
        self._group.awareness.state = value


@pytest.mark.parametrize("kind", [Feels, FeelsAll])
@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("timing", [Timing(), Timing(period=STEP, jitter=STEP // 2)], ids=["steady", "jittery"])
@settings(max_examples=10, deadline=None)
@given(faults=st.lists(st.tuples(st.integers(2, 12), st.integers(2, 12), st.sampled_from([0.25, 1.0])), max_size=3))
def test_offsets_add_up_and_each_measurement_is_wrong_once(
    kind: type[Component | GroupComponent], count: int, timing: Timing, faults: list[tuple[int, int, float]]
) -> None:
    """Also of who stands still, and when the turns of single agents fall apart."""
    ready = simulation({"a": Team({"feel": kind}, count=count, timings={"feel": timing})})
    group, found = ready.groups[0], []
    ready.events.subscribe(
        "stepped",
        lambda event: found.append((ready.clock.now, group.awareness.state - ready.environment.state(group))),
    )
    made = []
    for number, (start, length, offset) in enumerate(faults):
        concerned = [ComponentSelection(ready.entries[0], range(count))]
        written, bias = {"of": "*", "state": [offset, 0.0]}, np.array([offset, 0.0])
        made.append(
            fault(Bias, written, start, length, f"f{number}", components=concerned, bias=bias, deviation=np.zeros(2))
        )
        made[-1].at = start * STEP - STEP // 4
    summary = run(ready, 30, options=RunOptions(mode="asynchronous", faults=made))
    assert summary.status == "finished", summary.failure
    for now, wrong in found[1:]:
        step = now // STEP - 1  # what was measured in the step before
        offset = sum(each for start, length, each in faults if start <= step < start + length)
        late = sum(each for start, length, each in faults if start <= step + 1 < start + length)
        assert wrong[:, 1].tolist() == [0.0] * count
        # A turn that comes late may fall behind the beginning or the end that comes before the next step.
        assert all(each in ({offset, late} if timing.jitter else {offset}) for each in wrong[:, 0].tolist())
