"""Plans for specifications in runs: satisfied by the monitor, equal on every run, and what happens without a plan."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from simulating import present

from symaware_cli import RunResult, load
from symaware_cli.log.digest import digest
from symaware_cli.log.logged_events import LoggedEvent

pytest.importorskip("highspy", reason="HiGHS is an extra")

Array = NDArray[np.float64]


#: What is recorded about runs and verdicts, whoever plans.
OTHER = {"started", "finished", "satisfied", "violated"}


class Played(NamedTuple):
    """A run that was logged."""

    result: RunResult

    @property
    def events(self) -> list[LoggedEvent]:
        """The events of the planner."""
        return [event for event in self.result.events if event.name not in OTHER]

    @property
    def names(self) -> list[str]:
        return [event.name for event in self.events]

    @property
    def path(self) -> Array:
        """The true positions at the steps; shape (11, 2)."""
        return np.asarray(self.result.series("robot", "world").values)

    @property
    def verdicts(self) -> dict[str, str]:
        return {each.name: each.verdict for each in self.result.summary.specifications}

    @property
    def robustness(self) -> float:
        """The least of all specifications."""
        return min(present(each.robustness) for each in self.result.summary.specifications)


def played(
    folder: Path,
    formulas: dict[str, str],
    model: dict[str, Any] | None = None,
    seed: int = 3,
    duration: float = 5.0,
    **given: Any,
) -> Played:
    """Run a point from the origin, at most 1 m/s fast, which plans for all formulas."""
    document = {
        "symaware": 1,
        "name": "plans",
        "seed": seed,
        "run": {"duration": duration},
        "environment": {"use": "kinematic", "with": {"time_step": 0.5}},
        "regions": {
            "goal": {"box": [2, 3, -1, 1]},
            "wall": {"box": [1, 1.5, -1, 0.5]},
            "far": {"box": [5.4, 6.4, -1, 1]},
        },
        "specifications": {name: {"each": "robot", "formula": formula} for name, formula in formulas.items()},
        "agents": {
            "robot": {
                "model": {"use": "single-integrator", "with": {"max_speed": 1.0, **(model or {})}},
                "state": [0, 0],
                "components": {
                    "sense": {"use": "perception.self"},
                    "steer": {"use": "control.stl", "with": {"specifications": list(formulas), **given}},
                },
            }
        },
    }
    file = folder / "plans.yaml"
    file.write_text(yaml.safe_dump(document))
    return Played(load(file).run(output=folder / "plans.mcap"))


SAFE, ARRIVE = "always[0, 4] not inside(position, wall)", "eventually[0, 4] inside(position, goal)"


def test_a_plan_satisfies_the_specifications_as_robustly_as_it_says(tmp_path: Path) -> None:
    run = played(tmp_path, {"safe": SAFE, "arrive": ARRIVE})
    assert run.verdicts == {"safe": "satisfied", "arrive": "satisfied"}
    assert run.names == ["planned", "done"]
    assert run.robustness == pytest.approx(run.events[0].data["robustness"], abs=1e-6)


def test_noise_is_countered_at_every_step(tmp_path: Path) -> None:
    for seed in range(3):
        run = played(tmp_path, {"safe": SAFE, "arrive": ARRIVE}, {"process_noise": 0.05}, seed, deviations=3.0)
        assert run.verdicts == {"safe": "satisfied", "arrive": "satisfied"}
        assert "infeasible" not in run.names


def test_equal_runs_have_equal_logs(tmp_path: Path) -> None:
    digests = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        run = played(tmp_path / name, {"safe": SAFE, "arrive": ARRIVE}, {"process_noise": 0.05})
        digests.append(digest(run.result.log).combined)
    assert digests[0] == digests[1]


def test_specifications_in_conflict_are_named_and_no_others(tmp_path: Path) -> None:
    formulas = {"safe": SAFE, "arrive": "eventually[0, 1] inside(position, goal)", "slow": "always[0, 4] x < 3"}
    run = played(tmp_path, formulas)
    assert run.names[0] == "infeasible"
    assert run.events[0].data == {"conflict": ["arrive"], "left": 0}
    both = played(tmp_path, {"slow": "always[0, 4] x < 1", "arrive": ARRIVE, "safe": SAFE})
    assert both.events[0].data["conflict"] == ["slow", "arrive"]


def test_lost_specifications_are_given_up_and_the_rest_is_planned_for(tmp_path: Path) -> None:
    run = played(tmp_path, {"lost": "always[0, 4] x > 1", "arrive": ARRIVE})
    assert run.verdicts == {"lost": "violated", "arrive": "satisfied"}
    assert run.names[:2] == ["infeasible", "planned"]


#: Ways to say that it stays out of the wall, and that it reaches a region that takes 5.4 s, in a run of 8 s.
OPEN = ("always not inside(position, wall)", "not eventually inside(position, wall)", "always[1, 8] x < 6.2")
FAR = (
    "eventually[0, 6] inside(position, far)",
    "eventually inside(position, far)",
    "x < 5.6 until inside(position, far)",
    "eventually always inside(position, far)",
    "not always[0, 6] x < 5.5",
)


@pytest.mark.parametrize("far", FAR)
@pytest.mark.parametrize("stay", OPEN)
@pytest.mark.parametrize("is_one", [True, False])
def test_late_specifications_are_planned_for_beside_endless_ones(
    tmp_path: Path, stay: str, far: str, is_one: bool
) -> None:
    formulas = {"both": f"({stay}) and ({far})"} if is_one else {"stay": stay, "far": far}
    run = played(tmp_path, formulas, duration=8.0, gap=0.01)
    assert set(run.verdicts.values()) == {"satisfied"}
    planned = [event.data["robustness"] for event in run.events if event.name == "planned"]
    # No plan promises more than the region allows; and the last one, which lacks nothing, says what comes of it.
    assert max(planned) <= 1.0 + 1e-6
    assert run.robustness == pytest.approx(planned[-1], abs=1e-6)


def test_with_a_horizon_plans_recede_and_what_lies_beyond_is_open(tmp_path: Path) -> None:
    patrol = {"near": "always (x < 0.5 implies eventually[0, 1.5] x > 0.6)", "low": "always x < 0.8"}
    run = played(tmp_path, patrol, horizon=2.0, interval=0.5)
    assert run.verdicts["low"] == "satisfied"
    assert "done" not in run.names
    assert run.path[2:, 0].max() > 0.6


def test_a_control_input_may_be_held_for_several_steps(tmp_path: Path) -> None:
    run = played(tmp_path, {"arrive": ARRIVE}, hold=2)
    assert run.verdicts == {"arrive": "satisfied"}
    inputs = run.result.series("robot", "applied_control").values
    assert (inputs[:8:2] == inputs[1:8:2]).all()


def warnings_of(folder: Path, **changes: Any) -> list[str]:
    """Warnings about a boat that goes round a region to a dock, for 12 s in steps of 0.1 s."""
    document = {
        "symaware": 1,
        "name": "boat",
        "run": {"duration": 12.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "regions": {"water": {"box": [3, 5, -1.5, 1.5]}, "dock": {"box": [7, 9, -1, 1]}},
        "specifications": {"reach": {"each": "boat", "formula": changes.pop("formula", "eventually[0, 1] x < 3")}},
        "agents": {
            "boat": {
                "entity": {"shape": {"circle": {"radius": 0.2}}},
                "model": {"use": "single-integrator", "with": {"max_speed": 1.5, "process_noise": 0.02}},
                "state": [0, 0.2],
                "components": {
                    "sense": {"use": "perception.self"},
                    "plan": {"use": "control.stl", "with": {"specifications": ["reach"], **changes}},
                },
            }
        },
    }
    file = folder / "boat.yaml"
    file.write_text(yaml.safe_dump(document))
    return [each.message for each in load(file).validate().warnings]


LONG = "(always not inside(position, water)) and eventually[0, 10] inside(position, dock)"


@pytest.mark.parametrize("change", [{"horizon": 2.0}, {"nodes": 100}, {"formula": LONG.replace("10", "2")}])
def test_a_long_search_is_announced_with_its_size_and_what_would_shorten_it(
    tmp_path: Path, change: dict[str, Any]
) -> None:
    (said,) = warnings_of(tmp_path, formula=LONG, nodes=6000)
    for part in ("s of CPU time", "over 100 steps", "binary variables", "rows", "time_step", "`hold`", "6,000"):
        assert part in said
    shorter = warnings_of(tmp_path, **{"formula": LONG, "nodes": 6000, **change})
    assert not any("CPU" in each for each in shorter)


@pytest.mark.parametrize("formula", [LONG, "eventually x > 7", "always[0, 10] x < 3", "x < 2 until[0, 10] y > 1"])
def test_a_horizon_that_ends_before_something_is_due_is_announced(tmp_path: Path, formula: str) -> None:
    (said,) = [each for each in warnings_of(tmp_path, formula=formula, horizon=4.0) if "horizon" in each]
    assert "plans end after 4 s" in said


@pytest.mark.parametrize("formula", ["always x < 3", "always (x < 1 or eventually[0, 1] x < 0.5)"])
def test_a_horizon_for_what_has_to_hold_always_is_no_surprise(tmp_path: Path, formula: str) -> None:
    assert warnings_of(tmp_path, formula=formula, horizon=4.0) == []
