"""Schedules: which control input is requested when."""

from pathlib import Path

import pytest
from pydantic import ValidationError
from simulating import Team, made, simulate

from symaware_cli.engine.components.control.schedule import InputSchedule
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.log.reader import open_log
from symaware_cli.world import ParameterError

INPUTS = [{"time": 0.1, "input": [1.0, 0.0]}, {"time": 0.3, "input": [0.0, 2.0]}]


def test_each_control_input_holds_from_its_time_until_that_of_the_next(tmp_path: Path) -> None:
    team = Team(count=2, model=made(SingleIntegrator, max_speed=9.0))
    team.components = {"steer": lambda: made(InputSchedule, inputs=INPUTS)}
    simulate({"robot": team}, 10, tmp_path / "log.mcap")
    seen = open_log(tmp_path / "log.mcap").series("robot", "applied_control").values.reshape(-1, 2, 2)[-10:]
    expected = [[0.0, 0.0]] * 2 + [[1.0, 0.0]] * 4 + [[0.0, 2.0]] * 4
    assert seen.tolist() == [[each, each] for each in expected]


def test_times_ascend_and_inputs_are_those_of_the_model() -> None:
    with pytest.raises(ValidationError, match="not after that of the one before"):
        InputSchedule.Parameters.model_validate({"inputs": INPUTS[::-1]})
    schedule = made(InputSchedule, inputs=[{"time": 0.0, "input": [1.0, 0.0, 0.0]}])
    with pytest.raises(ParameterError, match="has 2 elements"):
        schedule.check(Team().group("robot"))
