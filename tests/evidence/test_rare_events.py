"""Estimates of rare events agree with known probabilities, and runs that cannot be split are rejected with a reason."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from checkout import CHECKOUT
from typer.testing import CliRunner

import symaware_cli as sa
from symaware_cli.cli.application import application
from symaware_cli.evidence.rare_event import RareEvent, split_run
from symaware_cli.evidence.splitting import RepeatWork, SplittingPlan
from symaware_cli.language.files import open_scenario
from symaware_cli.studies.executor import Blocks
from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.worker_pool import executor_of

SCENARIOS = CHECKOUT / "scenarios"
WALK = SCENARIOS / "random-walk.yaml"
LEVELS = [-11.5, -8.5, -5.5, -2.5]


def text_of(*arguments: str) -> tuple[int, str]:
    done = CliRunner().invoke(application, ["estimate", *map(str, arguments)])
    return done.exit_code, done.output


def plain(found: sa.RareEventEstimate) -> Any:
    """Return the values of an estimate that are reproducible."""
    return found.probability, [(each.counts, each.estimate, each.steps) for each in found.repeats]


#: An estimate from few trials of short runs, of which all repeats come to the event.
SMALL: dict[str, Any] = {"trials": 10, "repeats": 3, "changes": {"run.duration": 40.0}}


def small(**options: Any) -> sa.RareEventEstimate:
    return sa.estimate(WALK, "far", LEVELS, event="satisfied", **SMALL, **options)


@cache
def known() -> sa.RareEventEstimate:
    """The one that several tests compare with."""
    return small()


def test_the_estimate_for_the_walk_covers_the_known_probability() -> None:
    found = sa.estimate(
        WALK, "far", LEVELS, event="satisfied", trials=25, repeats=12, changes={"run.duration": 40.0}, confidence=0.999
    )
    assert found.probability.covers(0.00312465853)
    assert len(found.shares) == 5
    assert all(0.0 < share < 1.0 for share in found.shares)


def test_the_estimate_is_determined_by_the_seed() -> None:
    one, two = known(), small()
    assert plain(one) == plain(two)
    assert all(each.counts[-1].reached for each in one.repeats)
    other = small(seed=1)
    assert plain(other) != plain(one)


def test_descending_levels_to_a_violation_give_the_same_estimate() -> None:
    changes = {"specifications": {"near": {"each": "walker", "formula": "always x < 19.5"}}}
    options = {**SMALL, "changes": {**SMALL["changes"], **changes}}
    found = sa.estimate(WALK, "near", [11.5, 8.5, 5.5, 2.5], **options)
    assert [each.counts for each in found.repeats] == [each.counts for each in known().repeats]


def test_the_number_of_workers_does_not_affect_the_estimate() -> None:
    told: list[tuple[int, int]] = []
    shared = small(jobs=2, on_progress=lambda *at: told.append(at))
    assert plain(shared) == plain(known())
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_the_levels_chosen_by_a_pilot_can_be_passed_back() -> None:
    options = ["--event", "satisfied", "--trials", 10, "--repeats", 2, "--set", "run.duration=30", "--jobs", 0]
    arguments = [str(WALK), "--specification", "far", *map(str, options)]
    status, text = text_of(*arguments)
    assert status == 0
    (again,) = [line for line in text.splitlines() if "by a pilot of" in line]
    given = json.loads(text_of(*arguments, "--json", again.rpartition(" ")[2])[1])
    assert len(given["event"]["levels"]) >= 2
    assert given["pilot"] is None
    assert f"a probability of about {given['probability']['value']:.4g}" in text
    assert [line.split()[1] for line in text.splitlines() if line.startswith("  to ")] == [
        *(f"{level:g}" for level in given["event"]["levels"]),
        "satisfied",
    ]


@pytest.mark.slow
def test_the_estimate_with_levels_of_a_pilot_covers_the_known_probability() -> None:
    changes = {"run.duration": 40.0}
    found = sa.estimate(WALK, "far", event="satisfied", trials=40, repeats=8, changes=changes, confidence=0.999)
    assert found.probability.covers(0.00312465853)
    # The last stage is the remainder up to the event itself, so its share has no upper bound.
    *levels, last = found.shares
    assert all(0.05 < share < 0.6 for share in levels)
    assert last > 0.05


def test_a_pilot_draws_independently_of_the_trials() -> None:
    # With the same levels, the trials equal those of an estimate without a pilot.
    options: dict[str, Any] = {"event": "satisfied", "trials": 10, "repeats": 2, "changes": {"run.duration": 30.0}}
    found = sa.estimate(WALK, "far", **options)
    assert plain(sa.estimate(WALK, "far", found.plan.event.levels, **options)) == plain(found)


def test_pilots_for_violation_and_satisfaction_find_levels_of_opposite_sign() -> None:
    changes: dict[str, Any] = {"run.duration": 20.0}
    reached = sa.estimate(WALK, "far", event="satisfied", trials=10, repeats=2, changes=changes).plan.event.levels
    changes["specifications"] = {"near": {"each": "walker", "formula": "always x < 19.5"}}
    violated = sa.estimate(WALK, "near", trials=10, repeats=2, changes=changes).plan.event.levels
    assert violated == tuple(-level for level in reached)
    assert violated


def test_a_pilot_chooses_no_levels_for_frequent_events_or_without_robustness() -> None:
    often = {"often": {"each": "walker", "formula": "always x < 6.5"}}
    finite = {"often": {"each": "walker", "logic": "ltl", "formula": "always x < 19.5"}}
    for formula in (often, finite):
        changes = {"specifications": formula, "run.duration": 20.0}
        found = sa.estimate(WALK, "often", trials=10, repeats=2, changes=changes)
        assert found.plan.event.levels == ()
        assert found.pilot is not None


def test_without_levels_all_trials_are_plain_runs() -> None:
    arguments = [str(WALK), "--specification", "far", "--event", "satisfied", "--levels", "none"]
    status, text = text_of(*arguments, "--trials", "5", "--repeats", "2", "--jobs", "0", "--json")
    found = json.loads(text)
    assert (status, found["event"]["levels"], found["pilot"], len(found["shares"])) == (0, [], None, 1)


def test_errors_of_workers_are_reported_with_their_reasons() -> None:
    # Repeats are requested for a plan that was not checked before.
    plan = SplittingPlan(WALK, (), RareEvent("fra", "satisfied"), 2, 0)
    with (
        executor_of(RepeatWork(plan), 1) as executor,
        pytest.raises(SweepError, match="no specification `fra`; did"),
    ):
        [*executor.results(Blocks([0], 1))]


def test_an_unreached_level_is_reported() -> None:
    arguments = [str(WALK), "--specification", "far", "--event", "satisfied", "--levels=-11.5", "--trials", "3"]
    never = "agents.walker.components.walk.with.probabilities=[0, 1]"
    status, text = text_of(*arguments, "--repeats", "2", "--set", never)
    assert status == 0
    assert "no repeat came to the event" in text
    status, text = text_of(*arguments, "--repeats", "2", "--set", never, "--json")
    found = json.loads(text)
    assert (found["missed"], found["probability"]["value"], found["probability"]["upper"]) == (2, 0.0, 1.0)


@pytest.mark.parametrize(
    ("scenario", "arguments", "reason"),
    [
        (
            "random-walk.yaml",
            ["--specification", "fra"],
            "no specification `fra`; did you mean `far`?",
        ),
        ("random-walk.yaml", ["--specification", "far", "--levels", "a"], "--levels takes numbers"),
        ("random-walk.yaml", ["--specification", "far", "--levels", "1,2"], "are descending and above 0, not 1, 2"),
        ("random-walk.yaml", ["--specification", "far", "--event", "late"], "--event takes violated or satisfied"),
        ("random-walk.yaml", ["--specification", "far", "--confidence", "2"], "--confidence is between 0 and 1"),
        (
            "billiards.yaml",
            [
                "--specification",
                "in",
                "--set",
                'specifications={in: {each: referee, formula: "always norm(position) < 99"}}',
            ],
            "the run cannot be split: the state of the environment cannot be captured: its engine",
        ),
    ],
)
def test_invalid_estimates_are_rejected_with_the_reason(scenario: str, arguments: list[str], reason: str) -> None:
    status, text = text_of(str(SCENARIOS / scenario), "--trials", "2", "--repeats", "2", *arguments)
    assert status == 2
    assert reason in text


def test_different_seeds_give_different_futures_of_a_state() -> None:
    with sa.load(SCENARIOS / "noisy.yaml").start() as simulation:
        simulation.step(10)
        state, group = simulation.capture(), next(iter(simulation.groups))

        def future(seed: int | None) -> list[list[float]]:
            simulation.restore(state, seed)
            simulation.step(5)
            found: list[list[float]] = simulation.state(group).tolist()
            return found

        futures = [future(seed) for seed in (None, 1, 2)]
        assert futures[0] != futures[1] != futures[2]
        assert [future(seed) for seed in (None, 1, 2)] == futures


def test_a_trial_depends_on_its_seed_and_not_on_earlier_trials() -> None:
    event = RareEvent("far", "satisfied", (-10.5,))
    with split_run(open_scenario(WALK), event) as run:
        begin = run.begin()

        def taken(seed: int) -> int:
            before = run.steps
            run.reach(begin, 0, seed)
            return run.steps - before

        first = {seed: taken(seed) for seed in range(12)}
        assert {seed: taken(seed) for seed in reversed(first)} == first


def test_lost_messages_are_drawn_from_the_seed_given_to_restore() -> None:
    changes = {"topology.channel.loss": 0.5}
    with sa.load(SCENARIOS / "flooding.yaml", changes).start() as simulation:
        simulation.step(5)
        state = simulation.capture()
        dropped = []
        for seed in (1, 2, 1):
            simulation.restore(state, seed)
            simulation.step(40)
            dropped.append(simulation.capture().entries)
        assert dropped[0] == dropped[2] != dropped[1]


def test_a_finished_run_without_a_log_can_continue_from_an_earlier_state(tmp_path: Path) -> None:
    scenario = sa.load(SCENARIOS / "hello.yaml", {"run.duration": 1.0})
    with scenario.start() as simulation:
        simulation.step(5)
        state = simulation.capture()
        simulation.finish()
        end = simulation.state("robot").tolist()
        simulation.restore(state)
        assert not simulation.done
        assert simulation.steps == 5
        simulation.finish()
        assert simulation.state("robot").tolist() == end
    with scenario.start(output=tmp_path / "hello.mcap") as simulation:
        state = simulation.capture()
        simulation.finish()
        with pytest.raises(sa.StateError, match="its log is finished"):
            simulation.restore(state)
