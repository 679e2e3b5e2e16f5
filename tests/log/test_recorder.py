"""The recorder writes changes at the instants of the changes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from simulating import STEP, Team, simulate, simulation

from symaware_cli import Controller, GroupComponent, Log, Snapshot, TimeSeries, open_log
from symaware_cli.log.recorder import Recorder
from symaware_cli.log.writer import LogWriter


class Drift(Controller):
    def _compute(self) -> tuple[list[float], TimeSeries]:
        return [1.0, 0.0], TimeSeries()


class Present(GroupComponent):
    """Knows the world as it is."""

    def _compute(self) -> Snapshot:
        return self.environment.snapshot()

    def _update(self, value: Snapshot) -> None:
        self._group.awareness.world = value


class Late(Present):
    """Knows the world as it was a step ago."""

    before = None

    def _update(self, value: Snapshot) -> None:
        self._group.awareness.world, self.before = self.before, value


def recorded(components: Mapping[str, Any], count: int, folder: Path) -> Log:
    simulate({"a": Team(components, count=count)}, 4, folder / "log.mcap")
    return open_log(folder / "log.mcap")


def test_an_omniscient_agent_costs_two_bytes_a_step(tmp_path: Path) -> None:
    log = recorded({"see": Present, "go": Drift}, 3, tmp_path)
    messages = list(log.messages("/agents/a/awareness"))
    assert [message.decode().world for message in messages] == [True] * 4
    assert all(len(message.data) == 2 for message in messages)


def test_delayed_knowledge_of_the_world_is_recorded_in_full(tmp_path: Path) -> None:
    log = recorded({"see": Late, "go": Drift}, 2, tmp_path)
    messages = [message for message in log.messages("/agents/a/awareness") if message.time >= 2 * STEP]
    truth = log.series("a", "world")
    for message in messages:
        known = message.decode()
        assert not known.world
        assert known.lengths.tolist() == [1, 1]
        assert known.entities.tolist() == [1, 0]
        before = truth.values[truth.times.tolist().index(message.time - STEP)]
        np.testing.assert_array_equal(known.values.reshape(2, 4)[:, :2], before[::-1])
    assert len(messages) == 2


@pytest.mark.parametrize(
    ("omit", "left"),
    [
        ([], {"/agents/a/control", "/world/a/control"}),
        (["control"], set()),
        (["requested_control"], {"/world/a/control"}),
        (["applied_control"], {"/agents/a/control"}),
    ],
)
def test_requested_and_applied_control_inputs_are_omitted_one_by_one(
    omit: list[str], left: set[str], tmp_path: Path
) -> None:
    ready = simulation({"a": Team({"go": Drift}, count=1)})
    with LogWriter(tmp_path / "log.mcap") as writer:
        Recorder(writer, ready.environment, ready.groups, omit=omit)
    assert {topic for topic in open_log(tmp_path / "log.mcap").channels if topic.endswith("/control")} == left
