"""Batched runs are bitwise equal to the same runs executed alone."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from checkout import CHECKOUT
from numpy.typing import NDArray

from symaware_cli import GroupComponent, sweep
from symaware_cli.engine.runtime.run import Run
from symaware_cli.engine.runtime.run_summary import RunSummary
from symaware_cli.language.build import build
from symaware_cli.language.compose import compose
from symaware_cli.studies.batch import Batch
from symaware_cli.studies.batch_simulation import refusal
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.testing import assert_batchable

SCENARIOS = CHECKOUT / "scenarios"

#: The scenarios that can be batched, with the duration to run [s] and other changes.
BATCHED: dict[str, list[str]] = {
    "circle-swap.yaml": ["run.duration=4", "agents.robot.count=12"],
    "crossing.yaml": ["run.duration=3"],
    "head-on.yaml": ["run.duration=3"],
    "noisy.yaml": ["run.duration=2"],
    "patrol.yaml": ["run.duration=4"],
    "rendezvous.toml": ["run.duration=3"],
    "shortcut.yaml": ["run.duration=4"],
    "swarm.yaml": ["run.duration=1", "agents.vehicle.count=66"],
    "three-worlds.yaml": ["run.duration=3"],
}
Trace = list[list[bytes]]


def states_of(run: Run, share: int = 1, position: int = 0) -> list[bytes]:
    """The states and control inputs of one run of a batch."""
    found = []
    for group in run.simulation.groups:
        rows = len(group) // share
        own = slice(position * rows, (position + 1) * rows)
        states = run.simulation.environment.state(group)
        found += [states[own].tobytes(), group.control_input[own].tobytes()]
    return found


def alone(path: Path, changes: Sequence[str], seed: int) -> tuple[Trace, RunSummary]:
    """Return the steps and the summary of a run executed alone."""
    built = build(path, changes, seed)
    run = Run(built.simulation, built.steps, None, None, replace(built.options, may_exit=False))
    trace: Trace = []
    while run.status is None:
        trace.append(states_of(run))
        run.advance(1)
    return trace, run.summary


def together(path: Path, changes: Sequence[str], seeds: Sequence[int]) -> list[tuple[Trace, RunSummary]]:
    """Return the steps and the summary of each run of a batch."""
    built = build(path, changes)
    assert refusal(built) is None
    batch = Batch(compose(path, changes), built, seeds)
    traces: list[Trace] = [[] for _ in seeds]
    while batch.run.status is None:
        for position, trace in enumerate(traces):
            trace.append(states_of(batch.run, len(seeds), position))
        batch.run.advance(1)
    assert batch.run.failure is None
    return list(zip(traces, batch.summaries(), strict=True))


def without_wall_time(summary: RunSummary) -> dict[str, Any]:
    """Return a summary as plain data, without machine-dependent values, and without reasons, which batches omit."""
    found = asdict(replace(summary, wall_time=0.0))
    for each in found["specifications"]:
        for name in ("agents", "time", "reason"):
            del each[name]
    return found


@pytest.mark.parametrize("name", BATCHED)
def test_a_run_in_a_batch_equals_the_run_executed_alone(name: str) -> None:
    assert_batchable(SCENARIOS / name, BATCHED[name])


def test_every_step_and_metric_in_a_batch_equals_that_of_the_run_executed_alone() -> None:
    path, changes, seeds = SCENARIOS / "crossing.yaml", ["run.duration=2"], [5, 1, 8]
    for seed, (trace, summary) in zip(seeds, together(path, changes, seeds), strict=True):
        expected, alone_summary = alone(path, changes, seed)
        assert trace == expected
        assert without_wall_time(summary) == without_wall_time(alone_summary)


class Herd(GroupComponent):
    """Steers every agent to the mean of all rows, and thus of all runs."""

    batchable = True

    def _compute(self) -> NDArray[np.float64]:
        states = self.environment.state(self._group)
        return np.asarray(states[:, :2].mean(axis=0) - states[:, :2])

    def _update(self, value: NDArray[np.float64]) -> None:
        self._group.control_input = value


def test_the_conformance_kit_detects_a_component_whose_rows_depend_on_other_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    information = tmp_path / "herd-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: herd\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(f"[symaware.components]\nherd.mean = {__name__}:Herd\n")
    monkeypatch.syspath_prepend(tmp_path)
    document = {
        "symaware": 1,
        "name": "herd",
        "run": {"duration": 0.5},
        "environment": {"use": "kinematic"},
        "agents": {
            "sheep": {
                "count": 3,
                "model": {"use": "single-integrator"},
                "state": {"uniform": [-5, 5]},
                "components": {"see": {"use": "perception.self"}, "steer": {"use": "herd.mean"}},
            }
        },
    }
    (tmp_path / "herd.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(AssertionError, match=r"has other states or control inputs, .* in a batch of 3 than alone"):
        assert_batchable(tmp_path / "herd.yaml")
    with pytest.raises(AssertionError, match="cannot be batched: components of the asynchronous mode"):
        assert_batchable(tmp_path / "herd.yaml", ["run.mode=asynchronous"])


def test_initial_values_are_drawn_for_each_run(tmp_path: Path) -> None:
    document = yaml.safe_load((SCENARIOS / "crossing.yaml").read_text())
    group = next(iter(document["agents"].values()))
    width = 3 if group["model"]["use"] == "unicycle" else 2
    group["state"] = [{"uniform": [-4, 4]}] * width
    group["knowledge"] = {"goal": [{"normal": [0, 3]}, {"uniform": [-4, 4]}]}
    (tmp_path / "drawn.yaml").write_text(yaml.safe_dump({**document, "run": {"duration": 0.5}}))
    seeds = list(range(64))
    found = together(tmp_path / "drawn.yaml", (), seeds)
    assert len({trace[0][0] for trace, _ in found}) == 64
    for seed in (0, 17, 63):
        trace, summary = alone(tmp_path / "drawn.yaml", (), seed)
        assert found[seed][0] == trace
        assert without_wall_time(found[seed][1]) == without_wall_time(summary)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("asynchronous.yaml", "asynchronous"),
        ("billiards.yaml", "`pymunk`"),
        ("flooding.yaml", "network"),
        ("formation.yaml", "names single agents"),
        ("mpc.yaml", "one agent at a time"),
        ("traffic.yaml", "enter and leave"),
        ("convoy.yaml", "faults"),
    ],
)
def test_the_reason_is_given_if_runs_cannot_be_batched(name: str, why: str) -> None:
    built = build(SCENARIOS / name)
    reason = refusal(built)
    assert reason is not None
    assert why in reason


def test_specifications_of_pairs_in_a_batch_equal_those_of_single_runs(tmp_path: Path) -> None:
    document = yaml.safe_load((SCENARIOS / "crossing.yaml").read_text())
    name = next(iter(document["agents"]))
    document["specifications"] = {
        "apart": {"pairs": name, "formula": "always distance > 0.7"},
        "near": {"each": name, "formula": "eventually[0, 4] nearest < 1.5"},
        "both": {"pairs": [[name, name]], "formula": "always closing_speed < 9"},
        "told": {"each": name, "of": "belief", "formula": "always (nearest > 1 or once[0, 1] speed > 0.1)"},
    }
    (tmp_path / "pairs.yaml").write_text(yaml.safe_dump({**document, "run": {"duration": 4.5}}))
    seeds = [3, 1, 2]
    for seed, (_, summary) in zip(seeds, together(tmp_path / "pairs.yaml", (), seeds), strict=True):
        _, expected = alone(tmp_path / "pairs.yaml", (), seed)
        assert without_wall_time(summary) == without_wall_time(expected)
        assert len(summary.specifications) == 4


@pytest.mark.parametrize("jobs", [0, 2])
def test_a_sweep_has_the_same_rows_with_and_without_batches(tmp_path: Path, jobs: int) -> None:
    tables = [
        sweep(
            SCENARIOS / "noisy.yaml",
            tmp_path / str(batch),
            changes={"run.duration": 1.0},
            over={"agents.straight.components.sense.with.range": [1.0, 9.0]},
            runs=6,
            jobs=jobs,
            batch=batch,
        )
        for batch in (1, None, 4)
    ]
    assert tables[0].num_rows == 12
    assert len(set(tables[0]["digest"].to_pylist())) == 12
    assert tables[1].equals(tables[0])
    assert tables[2].equals(tables[0])


def test_runs_that_draw_initial_states_and_knowledge_are_batched(tmp_path: Path) -> None:
    document = yaml.safe_load((SCENARIOS / "crossing.yaml").read_text())
    name = next(iter(document["agents"]))
    document["agents"][name]["knowledge"]["calm"] = 1.0
    (tmp_path / "drawn.yaml").write_text(yaml.safe_dump({**document, "run": {"duration": 0.5}}))
    options: dict[str, Any] = {
        "over": {
            f"agents.{name}.state": {"choice": [{"circle": {"radius": 3.0}}, {"circle": {"radius": 5.0}}]},
            f"agents.{name}.knowledge.calm": {"uniform": [0, 1]},
        },
        "runs": 8,
    }
    alone, batched = (
        sweep(tmp_path / "drawn.yaml", tmp_path / str(batch), batch=batch, **options) for batch in (1, None)
    )
    assert batched.equals(alone)
    assert len({*batched["digest"].to_pylist()}) > 1
    assert SweepFolder.opened(tmp_path / "None").one_by_one() is None
    assert SweepFolder.opened(tmp_path / "1").one_by_one(1) == "batches are switched off"


def test_runs_that_draw_other_parameters_are_executed_one_by_one(tmp_path: Path) -> None:
    changes, over = {"run.duration": 0.2}, {"agents.straight.components.sense.with.range": {"uniform": [1.0, 9.0]}}
    sweep(SCENARIOS / "noisy.yaml", tmp_path / "out", changes=changes, over=over, runs=3)
    reason = "runs differ in more than seeds, initial states and knowledge"
    assert SweepFolder.opened(tmp_path / "out").one_by_one() == reason


def test_a_failing_run_costs_only_its_own_row_even_in_a_batch(tmp_path: Path) -> None:
    document = yaml.safe_load((SCENARIOS / "crossing.yaml").read_text())
    name = next(iter(document["agents"]))
    document["agents"][name]["knowledge"]["signed"] = {"uniform": [-0.1, 1]}
    document["specifications"] = {"odd": {"each": name, "formula": "always sqrt(signed) >= 0"}}
    (tmp_path / "odd.yaml").write_text(yaml.safe_dump({**document, "run": {"duration": 0.5}}))
    alone, batched = (sweep(tmp_path / "odd.yaml", tmp_path / str(batch), runs=8, batch=batch) for batch in (1, None))
    assert {"done", "failed"} == set(alone["state"].to_pylist())
    assert batched.equals(alone)


@pytest.mark.parametrize(
    "state",
    [
        {"normal": [[1.0, -1.0], 0.5]},
        [{"uniform": [-4, 4]}, 3],
        {"each": [[0, {"normal": [0, 1]}], [{"uniform": [-1, 1]}, 2], {"uniform": [-3, 3]}]},
        {"circle": {"radius": 3.0}},
    ],
)
def test_initial_conditions_of_any_form_equal_those_of_single_runs(tmp_path: Path, state: Any) -> None:
    document = {
        "symaware": 1,
        "name": "starts",
        "run": {"duration": 0.2},
        "environment": {"use": "kinematic"},
        "agents": {
            "robot": {
                "count": 3,
                "model": {"use": "single-integrator"},
                "state": state,
                "knowledge": {"goal": {"uniform": [[-9, -9], [9, 9]]}},
                "components": {"see": {"use": "perception.self"}, "steer": {"use": "control.go-to-goal"}},
            }
        },
    }
    (tmp_path / "starts.yaml").write_text(yaml.safe_dump(document))
    assert_batchable(tmp_path / "starts.yaml")


@pytest.mark.parametrize(
    "until",
    [
        "all(goals_reached)",
        "min_separation < 0.8 or contacts > 1",
        "highest_risk > 0.3 and time > 0.5",
        'inside(position["robot.1"], middle) and agents == 3',
        'min(state["robot"][0]) < -2 or norm(position["robot"]) < 4',
    ],
)
def test_a_run_that_ends_early_leaves_its_batch(tmp_path: Path, until: str) -> None:
    document = {
        "symaware": 1,
        "name": "ends",
        "run": {"duration": 6.0, "until": until},
        "environment": {"use": "kinematic"},
        "regions": {"middle": {"circle": {"centre": [0, 0], "radius": 1.0}}},
        "agents": {
            "robot": {
                "count": 3,
                "entity": {"shape": {"circle": {"radius": 0.4}}},
                "model": {"use": "unicycle", "with": {"max_speed": 2.0, "process_noise": 0.01}},
                "state": [{"uniform": [-3, 3]}, {"uniform": [-3, 3]}, 0],
                "knowledge": {"goal": [{"uniform": [-2, 2]}, 0.5]},
                "components": {
                    "see": {"use": "perception.omniscient"},
                    "risk": {"use": "risk.time-to-collision", "with": {"horizon": 3.0}},
                    "steer": {"use": "control.go-to-goal"},
                },
            }
        },
    }
    (tmp_path / "ends.yaml").write_text(yaml.safe_dump(document))
    assert_batchable(tmp_path / "ends.yaml")
    found = together(tmp_path / "ends.yaml", (), range(12))
    assert len({summary.steps for _, summary in found}) > 1
    for seed in (0, 5, 11):
        _, expected = alone(tmp_path / "ends.yaml", (), seed)
        assert without_wall_time(found[seed][1]) == without_wall_time(expected)


@pytest.mark.parametrize(
    ("until", "why"),
    [
        ('violated["safe"]', "`run.until` refers to `violated`"),
        ("time > 1", "specifications are final when `run.until` ends their run"),
    ],
)
def test_runs_whose_end_depends_on_specifications_are_not_batched(until: str, why: str) -> None:
    assert refusal(build(SCENARIOS / "shortcut.yaml", [f"run.until={until}"])) == why


@pytest.mark.parametrize("shape", [{"circle": {"radius": 0.3}}, {"box": {"length": 0.5, "width": 0.5}}])
def test_contacts_in_a_batch_are_debounced_as_in_single_runs(tmp_path: Path, shape: dict[str, Any]) -> None:
    """Contacts of robots that noise moves while they just touch each other and a pillar."""
    wide = next(iter(shape.values()))
    gap = 2 * wide["radius"] if "radius" in wide else wide["length"]
    document = {
        "symaware": 1,
        "name": "shaken",
        "run": {"duration": 5.0},
        "environment": {
            "use": "kinematic",
            "with": {"time_step": 0.05},
            "entities": {"pillar": {"shape": shape, "position": [-gap, 0.0]}},
        },
        "agents": {
            "robot": {
                "count": 2,
                "entity": {"shape": shape},
                "model": {"use": "single-integrator", "with": {"process_noise": [0.01, 0.01]}},
                "state": [[0.0, 0.0], [gap, 0.0]],
                "components": {"sense": {"use": "perception.self"}},
            }
        },
    }
    path = tmp_path / "shaken.yaml"
    path.write_text(yaml.safe_dump(document))
    counts = []
    for debounce in (0.0, 0.05, 0.2, 1.0):
        changes, seeds = [f"environment.with.debounce={debounce}"], [5, 1, 8]
        found = [summary.contacts for _, summary in together(path, changes, seeds)]
        assert found == [alone(path, changes, seed)[1].contacts for seed in seeds]
        counts.append(sum(found))
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > counts[-1] > 0
