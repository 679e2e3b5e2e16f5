"""Beliefs of agents about others are recorded completely: states, covariances, ages, intents, uncertainties and
risks."""

from pathlib import Path
from typing import Any

import numpy as np
from simulating import Team, present, simulate

from symaware_cli import AwarenessVector, Component, GroupComponent, Log, TimeSeries, open_log
from symaware_cli.engine.components.perception import OmniscientPerception, SelfPerception
from symaware_cli.engine.components.perception_range import RangePerception
from symaware_cli.log import others_message
from symaware_cli.log import symaware_v1_pb2 as v1

STEP = 50_000_000


class Writes(Component):
    """Has a belief about another, another one from the third step on, and forgets its intent at the fifth."""

    def _compute(self) -> TimeSeries:
        step = self.now // STEP
        intent = {1.0: [1.0, 2.0]} if step < 2 else {1.0: [3.0, 4.0], 2.0: [5.0, 6.0]}
        return TimeSeries() if step >= 4 else TimeSeries(intent)

    def _update(self, value: TimeSeries) -> None:
        if self._agent.row:
            return
        other = self._agent.awareness_database
        if "robot.1" not in other:
            other["robot.1"] = AwarenessVector("robot.1", [7.0, 8.0, 0.0, 0.0], risk=TimeSeries({0.0: 0.5}))
        other["robot.1"].intent = value


def recorded(tmp_path: Path, see: type[GroupComponent]) -> Log:
    simulate({"robot": Team({"see": see, "write": Writes}, count=2)}, 7, tmp_path / "log")
    return open_log(tmp_path / "log")


def test_intents_and_risks_of_others_are_in_the_log_when_they_change(tmp_path: Path) -> None:
    log = recorded(tmp_path, SelfPerception)
    beliefs = log.beliefs("robot.0", "robot.1")
    intents = [(each.time // STEP, each.values.tolist()) for each in beliefs.series["intent"]]
    assert intents == [(0, [[1.0, 2.0]]), (2, [[3.0, 4.0], [5.0, 6.0]]), (4, [])]
    assert [each.values.tolist() for each in beliefs.series["risk"]] == [[[0.5]]]
    assert "uncertainty" not in beliefs.series
    assert beliefs.values.tolist() == [[7.0, 8.0, 0.0, 0.0]]
    assert not log.beliefs("robot.1", "robot.0").series


def test_received_intents_are_recorded_beside_perceived_states(tmp_path: Path) -> None:
    log = recorded(tmp_path, OmniscientPerception)
    beliefs = log.beliefs("robot.0", "robot.1")
    assert len(beliefs.series["intent"]) == 3
    assert beliefs.values[:, 0].tolist() == [1.0] * len(beliefs.times)
    assert (
        len({message.time for message in log.messages("/agents/robot/awareness")})
        == log.channels["/agents/robot/awareness"].count
    )


def test_a_belief_about_another_agent_does_not_hide_detections_of_others_from_the_log(tmp_path: Path) -> None:
    def see() -> RangePerception:
        return RangePerception(RangePerception.Parameters(range=50.0))

    class WritesOnce(Component):
        def _compute(self) -> None:
            return None

        def _update(self, value: Any) -> None:
            if self._agent.row == 0 and "ghost" not in self._agent.awareness_database:
                self._agent.awareness_database["robot.1"] = AwarenessVector("robot.1", [9.0, 9.0])

    simulate({"robot": Team({"see": see, "write": WritesOnce}, count=2)}, 3, tmp_path / "log")
    log = open_log(tmp_path / "log")
    assert log.beliefs("robot.0", "robot.1").column("x").tolist() == [9.0] * 3
    assert log.beliefs("robot.1", "robot.0").column("x").tolist() == [0.0] * 3


def test_series_of_others_are_encoded_as_the_generated_classes_write_them() -> None:
    lengths, entities, columns, points = [2, 0], [1, 4], [2, 1], [2, 1]
    times, values = [5, 6, 7], [1.0, 2.0, 3.0, 4.0, 5.0]
    series = v1.OthersSeries(
        part="intent", rows=[0, 3], lengths=lengths, entities=entities, columns=columns, points=points
    )
    series.times.extend(times)
    series.values.extend(values)
    data = others_message.encode_others_series("intent", lengths, entities, columns, points, times, values, [0, 3])
    assert data == v1.Awareness(series=[series]).SerializeToString(deterministic=True)
    for content in (others_message.WHOLE_WORLD + data + data, data + others_message.WHOLE_WORLD + data):
        message = others_message.decode_awareness(content)
        assert message.world
        assert len(message.series) == 2
        found = [(place, other, t.tolist(), v.tolist()) for place, other, t, v in message.series[1]]
        assert found == [(0, 1, [5, 6], [[1.0, 2.0], [3.0, 4.0]]), (0, 4, [7], [[5.0]])]
    assert not others_message.decode_awareness(data).has_states
    assert np.array_equal(present(others_message.decode_awareness(data).series[0].rows), [0, 3])
