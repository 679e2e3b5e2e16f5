from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import symaware_cli as sa

SCENARIOS = Path(__file__).parents[2] / "scenarios"


@pytest.mark.parametrize("name", ["hello", "noisy", "gatekeeper", "asynchronous"])
def test_a_simulation_that_goes_back_to_a_mark_is_in_the_same_state_and_continues_equally(name: str) -> None:
    with sa.load(SCENARIOS / f"{name}.yaml").start(seed=3) as simulation:
        simulation.step(5)
        mark, state = simulation.mark(), simulation.capture().to_bytes()
        simulation.step(10)
        after = simulation.capture().to_bytes()
        simulation.go_back(mark)
        assert simulation.capture().to_bytes() == state
        simulation.step(10)
        assert simulation.capture().to_bytes() == after


def test_a_simulation_goes_back_after_its_end() -> None:
    with sa.load(SCENARIOS / "head-on.yaml").start(seed=3) as simulation:
        mark = simulation.mark()
        first = simulation.finish().summary.minimum_separation
        simulation.go_back(mark)
        assert not simulation.done
        assert simulation.finish().summary.minimum_separation == first


def test_another_seed_draws_other_noise_as_a_new_simulation_would() -> None:
    noise = {"agents.robot.model.with.process_noise": [0.1, 0.1, 0.1]}
    scenario = sa.load(SCENARIOS / "head-on.yaml", noise)
    with scenario.start(seed=3) as simulation, scenario.start(seed=4) as other:
        mark = simulation.mark()
        simulation.step(5)
        simulation.go_back(mark, seed=4)
        simulation.step(5)
        other.step(5)
        assert simulation.state("robot").tobytes() == other.state("robot").tobytes()


def test_a_simulation_with_a_log_has_no_marks(tmp_path: Path) -> None:
    scenario = sa.load(SCENARIOS / "head-on.yaml")
    with (
        scenario.start(output=tmp_path / "log.mcap") as simulation,
        pytest.raises(sa.StateError, match="its log is finished"),
    ):
        simulation.mark()


def test_within_a_step_beliefs_are_those_of_the_present_and_inputs_act_at_it() -> None:
    scenario = sa.load(SCENARIOS / "head-on.yaml")
    with scenario.start(seed=3, within_steps=True) as within, scenario.start(seed=3) as between:
        assert within.step() == 0
        for _ in range(5):
            assert (within.belief("robot") == within.state("robot")).all()
            within.set_control("robot.0", [1.0, 0.5])
            between.set_control("robot.0", [1.0, 0.5])
            assert within.step() == between.step() == 1
            assert within.state("robot").tobytes() == between.state("robot").tobytes()
        assert not np.array_equal(between.belief("robot"), between.state("robot"))
        assert within.finish().summary.minimum_separation == between.finish().summary.minimum_separation
