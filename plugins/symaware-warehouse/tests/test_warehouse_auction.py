"""Robots auction offered specifications by their risk; failures lead to another auction."""

from __future__ import annotations

import pytest
from simulating import in_process as command
from symaware_warehouse.tube import Tube, TubeKind
from warehouse_runs import SCENARIOS, run

from symaware_cli import Log


def holders(log: Log) -> dict[str, list[str]]:
    """The robots that accepted each specification, in order."""
    found: dict[str, list[str]] = {}
    for event in log.events():
        if event.name == "accepted":
            found.setdefault(event.data["specification"], []).append(event.data["agent"])
    return found


def test_equal_bids_go_to_the_first_robot_and_accepted_specifications_hold() -> None:
    log = run("two-robots.yaml")
    assert holders(log) == {"fetch_2": ["robot.0"], "fetch_3": ["robot.1"]}
    assert [each.verdict for each in log.outcomes] == ["satisfied"] * 3


def test_an_epsilon_below_the_least_risk_of_all_steps_is_refused_before_the_run() -> None:
    done = command("validate", SCENARIOS / "two-robots.yaml", "--set", "parameters.epsilon=0.05")
    assert done.returncode == 2
    assert "its 14 steps have a risk of at least 0.14, above its epsilon of 0.05" in done.stderr
    sets = ("--set", "parameters.epsilon=0.05", "--set", "parameters.least_risk=0.001")
    assert command("validate", SCENARIOS / "two-robots.yaml", *sets).returncode == 0


@pytest.mark.slow
@pytest.mark.xdist_group("_weak-motors.yaml")  # one process makes the run that several tests look at
def test_robots_with_weak_motors_accept_no_specification() -> None:
    log = run("_weak-motors.yaml")
    fetched = {agent for name, agents in holders(log).items() if name.startswith("fetch") for agent in agents}
    assert fetched == {"robot.0", "robot.1", "robot.3"}
    assert all(each.verdict == "satisfied" for each in log.outcomes)


@pytest.mark.slow
@pytest.mark.xdist_group("_auctioned.yaml")
def test_the_auction_of_the_published_case_gives_its_allocation_with_the_names_of_the_robots_exchanged() -> None:
    log = run("_auctioned.yaml")
    found = holders(log)
    # There fetch_1 to 3 went to D, A and B, and fetch_4 and 5 to B and D, with the same total the other way round.
    assert [found[f"fetch_{number}"] for number in (1, 2, 3)] == [["robot.0"], ["robot.1"], ["robot.2"]]
    assert [found[f"fetch_{number}"] for number in (4, 5)] == [["robot.0"], ["robot.2"]]
    assert [each.verdict for each in log.outcomes] == ["satisfied"] * 10


@pytest.mark.slow
def test_specifications_of_a_failed_robot_go_to_another_and_accepted_ones_hold() -> None:
    log = run("failing-robots.yaml")
    assert holders(log)["fetch_4"] == ["robot.1", "robot.0", "robot.3"]
    assert holders(log)["home_d"] == ["robot.3"]
    verdicts = {each.name: each.verdict for each in log.outcomes}
    assert {name for name, verdict in verdicts.items() if verdict == "rejected"} == {"home_a", "home_b"}
    assert set(verdicts.values()) == {"satisfied", "rejected"}


def bids(log: Log, at: float) -> dict[str, dict[str, float]]:
    """What each robot bid at an instant, by the robot and the specification."""
    told = (each for each in log.events() if each.name == "bid" and each.source.endswith(".plan"))
    told_then = (each for each in told if each.time == at * 1e9)
    return {each.source.removeprefix("agents.").removesuffix(".plan"): each.data["costs"] for each in told_then}


@pytest.mark.slow
@pytest.mark.xdist_group("grades.yaml")
def test_the_more_a_robot_is_disturbed_the_higher_the_risk_that_it_bids_and_the_allocation_follows() -> None:
    log = run("grades.yaml")
    for at in (1.0, 15.0):
        offered = bids(log, at)
        for name in offered["robot.0"]:
            first, second, third, fourth = (offered[f"robot.{row}"][name] for row in range(4))
            assert max(first, fourth) < second < third
    fetched = [set(holders(log)[f"fetch_{number}"]) for number in range(1, 6)]
    assert set().union(*fetched[:3]) == {"robot.0", "robot.1", "robot.3"}
    assert set().union(*fetched[3:]) == {"robot.0", "robot.3"}
    assert {each.verdict for each in log.outcomes} == {"satisfied"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "scenario",
    [
        pytest.param(name, marks=pytest.mark.xdist_group(name))
        for name in ("grades.yaml", "_auctioned.yaml", "_weak-motors.yaml")
    ],
)
def test_specifications_arrive_at_the_published_steps_and_are_assigned_within_one(scenario: str) -> None:
    log = run(scenario)
    offered = {each.data["specification"]: each.time / 1e9 for each in log.events() if each.name == "offered"}
    assert offered == {
        **{f"fetch_{number}": 1.0 if number < 4 else 15.0 for number in range(1, 6)},
        **{f"home_{letter}": 30.0 for letter in "abcd"},
    }
    for event in log.events():
        if event.name == "accepted":
            assert event.time / 1e9 - offered[event.data["specification"]] < 1.0


@pytest.mark.parametrize("kind", ["chebyshev", "gaussian"])
@pytest.mark.parametrize("widest", [0.8, 1.5])
def test_with_the_same_greatest_radius_the_least_risk_grows_with_the_variance(kind: TubeKind, widest: float) -> None:
    risks = [Tube.of(kind, variance, 1e-300, widest=widest).least_risk for variance in (0.005, 0.01, 0.02, 0.04, 0.08)]
    assert risks == sorted(risks)
    assert len(set(risks)) == len(risks)
    assert Tube.of(kind, 0.01, 0.01, widest=1e9) == Tube.of(kind, 0.01, 0.01)
    with pytest.raises(ValueError, match="wide"):
        Tube.of(kind, 0.01, 0.01, widest=0.01)


@pytest.mark.parametrize("variance", ["none", -1, 0])
def test_an_invalid_variance_is_refused(variance: object) -> None:
    done = command(
        "validate", SCENARIOS / "grades.yaml", "--set", f"agents.robot.knowledge.variance={{all: {variance}}}"
    )
    assert done.returncode == 2
    assert "the knowledge `variance` of robot.0 must be a number above 0" in done.stderr
