"""Messages that a fault delivers in time or lets be lost otherwise, and faults that do not happen."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

import symaware_cli as sa

BAD: dict[str, Any] = {"use": "complete", "channel": {"delay": 0.35, "jitter": 0.2, "loss": 0.4}}


def run(folder: Path, faults: Mapping[str, Any], topology: Any = BAD) -> sa.Log:
    agent = {
        "model": {"use": "single-integrator"},
        "knowledge": {"goal": [9.0, 0.0]},
        "components": {
            "see": {"use": "perception.self"},
            "inbox": {"use": "communication.inbox"},
            "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0}},
            "tell": {"use": "communication.broadcast"},
        },
    }
    tree: dict[str, Any] = {"symaware": 1, "name": "links", "seed": 2, "run": {"duration": 2.0}, "topology": topology}
    tree |= {"environment": {"use": "kinematic", "with": {"time_step": 0.1}}, "faults": dict(faults)}
    tree |= {"agents": {name: {**agent, "state": [0.0, float(row)]} for row, name in enumerate("abc")}}
    (folder / "links.yaml").write_text(yaml.safe_dump(tree, sort_keys=False))
    log = folder / "links.mcap"
    log.unlink(missing_ok=True)
    sa.load(folder / "links.yaml").run(output=log)
    return sa.open_log(log)


def fates(log: sa.Log) -> dict[tuple[str, str, int], int | str]:
    """When each message can be read, in steps, or why it was lost, by its link and the step in which it was sent."""
    step = 100_000_000
    return {
        (each.sender, each.receiver, each.sent_time // step): each.reason or -(-each.time // step)
        for each in log.communications()
        if each.stage != "sent"
    }


def differing(one: Mapping[Any, Any], other: Mapping[Any, Any]) -> set[Any]:
    return {each for each in one.keys() | other.keys() if one.get(each) != other.get(each)}


@pytest.mark.parametrize(
    ("topology", "storm"),
    [
        (BAD, None),
        ({**BAD, "channel": {**BAD["channel"], "bandwidth": 2000, "queue_length": 2, "drop": "head"}}, None),
        ({**BAD, "channel": {"delay": 0.25, "in_order": True, "max_age": 0.2}}, None),
        ({"use": "complete"}, {"at": 0.0, "cut": {"between": ["a", "b"]}}),
    ],
)
def test_messages_of_a_link_arrive_in_time_and_all_others_meet_the_same_fates(
    topology: Any, storm: Any, tmp_path: Path
) -> None:
    faults = {"storm": storm} if storm else {}
    without = fates(run(tmp_path, faults, topology))
    deliver = {"at": 0.5, "for": 0.8, "deliver": {"sender": "a", "receiver": "b"}}
    found = fates(run(tmp_path, {**faults, "good": deliver}, topology))
    timely = {("a", "b", step): step + 1 for step in range(5, 13)}
    assert timely.items() <= found.items()
    assert differing(without, found) <= timely.keys()
    assert differing(without, found)


def test_a_link_that_the_topology_does_not_have_stays_without_messages(tmp_path: Path) -> None:
    edges = {"use": "graph", "with": {"edges": [["b", "c"]]}}
    log = run(tmp_path, {"good": {"at": 0.0, "deliver": {"sender": "a", "receiver": "b"}}}, edges)
    assert {each[:2] for each in fates(log)} == {("b", "c"), ("c", "b")}


def test_the_placebo_draws_the_fates_of_the_same_messages_anew_and_no_others(tmp_path: Path) -> None:
    without, found = fates(run(tmp_path, {})), []
    for draw in (0, 1):
        placebo = {"at": 0.5, "for": 0.8, "deliver": {"sender": "a", "receiver": "b", "placebo": True, "draw": draw}}
        found.append(fates(run(tmp_path, {"anew": placebo})))
        changed = differing(without, found[-1])
        assert {each[:2] for each in changed} == {("a", "b")}
        assert {each[2] for each in changed} <= set(range(5, 13))
        assert {each for each in found[-1].values() if isinstance(each, str)} == {"loss"}
    assert differing(*found)


def heights(log: sa.Log, agent: str) -> list[float]:
    return [float(each) for each in log.series(agent, "world").values[:, 1]]


@pytest.mark.parametrize("at", [0.0, 0.5, 1.0])
def test_a_fault_that_is_prevented_before_it_begins_or_at_its_instant_does_not_happen(
    at: float, tmp_path: Path
) -> None:
    push = {"at": 1.0, "push": {"of": "a", "by": [0.0, 3.0]}}
    without = heights(run(tmp_path, {}), "a")
    assert max(heights(run(tmp_path, {"gust": push}), "a")) > 2.0
    log = run(tmp_path, {"gust": push, "none": {"at": at, "prevent": "gust"}})
    assert heights(log, "a") == without
    assert [event.text for event in log.events() if event.name == "fault"] == ["none: prevents gust"]


def test_a_fault_that_is_prevented_after_it_has_begun_ends(tmp_path: Path) -> None:
    cut = {"at": 0.5, "cut": {"between": ["a", "b"]}}
    found = fates(run(tmp_path, {"axe": cut, "none": {"at": 1.0, "prevent": "axe"}}, {"use": "complete"}))
    assert {each[2] for each, fate in found.items() if fate == "axe"} == set(range(5, 10))


def test_a_fault_on_an_event_is_prevented_as_well(tmp_path: Path) -> None:
    cut = {"on": {"event": "fault", "of": "agents.a"}, "cut": {"between": ["a", "b"]}}
    gust = {"at": 1.0, "push": {"of": "a", "by": [0.0, 0.1]}}
    assert "axe" in fates(run(tmp_path, {"gust": gust, "axe": cut}, {"use": "complete"})).values()
    faults = {"gust": gust, "axe": cut, "none": {"at": 0.5, "prevent": "axe"}}
    assert "axe" not in fates(run(tmp_path, faults, {"use": "complete"})).values()


def test_an_unpreventable_fault_is_reported_at_its_place(tmp_path: Path) -> None:
    with pytest.raises(sa.ScenarioError, match="gus"):
        run(tmp_path, {"gust": {"at": 1.0, "stop": "a"}, "none": {"at": 0.5, "prevent": "gus"}})
