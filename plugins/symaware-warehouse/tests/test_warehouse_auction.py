"""Robots auction what is offered by the risk that they would have; failures lead to another auction."""

from __future__ import annotations

import pytest
from warehouse_runs import SCENARIOS, command, run

from symaware_cli import Log


def holders(log: Log) -> dict[str, list[str]]:
    """The robots that accepted each specification, in order."""
    found: dict[str, list[str]] = {}
    for event in log.events():
        if event.name == "accepted":
            found.setdefault(event.data["specification"], []).append(event.data["agent"])
    return found


def test_equal_bids_go_to_the_first_robot_and_what_was_accepted_holds() -> None:
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
def test_robots_with_weak_motors_fetch_nothing() -> None:
    log = run("_weak-motors.yaml")
    fetched = {agent for name, agents in holders(log).items() if name.startswith("fetch") for agent in agents}
    assert fetched == {"robot.0", "robot.1", "robot.3"}
    assert all(each.verdict == "satisfied" for each in log.outcomes)


@pytest.mark.slow
def test_the_auction_of_the_published_case_gives_its_allocation_with_the_names_of_the_robots_exchanged() -> None:
    log = run("_auctioned.yaml")
    found = holders(log)
    # There fetch_1 to 3 went to D, A and B, and fetch_4 and 5 to B and D, with the same total the other way round.
    assert [found[f"fetch_{number}"] for number in (1, 2, 3)] == [["robot.0"], ["robot.1"], ["robot.2"]]
    assert [found[f"fetch_{number}"] for number in (4, 5)] == [["robot.0"], ["robot.2"]]
    assert [each.verdict for each in log.outcomes] == ["satisfied"] * 10


@pytest.mark.slow
def test_what_a_failed_robot_held_goes_to_another_and_nothing_that_was_accepted_is_violated() -> None:
    log = run("failing-robots.yaml")
    assert holders(log)["fetch_4"] == ["robot.1", "robot.3"]
    assert holders(log)["home_d"] == ["robot.3"]
    verdicts = {each.name: each.verdict for each in log.outcomes}
    assert {name for name, verdict in verdicts.items() if verdict == "rejected"} == {"home_a", "home_b"}
    assert set(verdicts.values()) == {"satisfied", "rejected"}
