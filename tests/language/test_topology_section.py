"""The `topology` section, from the file to the log."""

import itertools
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from simulating import untyped

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log.digest import digest
from symaware_cli.testing import assert_repeatable

STEP = 50_000_000

SCENARIO = {
    "symaware": 1,
    "name": "talk",
    "seed": 3,
    "run": {"duration": 2.0},
    "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
    "agents": {
        "car": {
            "model": {"use": "single-integrator"},
            "state": [0.0, 1.0],
            "components": {
                "tell": {"use": "communication.broadcast", "period": 0.2},
                "hear": {"use": "communication.inbox"},
            },
        },
        "robot": {
            "count": 5,
            "model": {"use": "single-integrator"},
            "state": {"circle": {"radius": 3.0}},
            "knowledge": {"goal": {"circle": {"radius": 3.0, "phase": 3.0}}},
            "components": {
                "sense": {"use": "perception.self"},
                "tell": {"use": "communication.state", "period": 0.1, "with": {"knowledge": ["goal"]}},
                "hear": {"use": "communication.inbox"},
                "steer": {"use": "control.go-to-goal"},
            },
        },
    },
    "topology": {
        "use": "range",
        "with": {"range": 4.0, "hysteresis": 0.2},
        "channel": {"delay": {"exponential": 0.04}, "jitter": 0.02, "loss": 0.2, "duplication": 0.1},
        "links": [{"sender": "car", "channel": {"loss": 0.5}}, {"receiver": "robot.3", "channel": {"delay": 0.3}}],
    },
}


def changed(**changes: Any) -> Any:
    """The scenario with other values at dotted paths; None takes a key away."""
    document = yaml.safe_load(yaml.safe_dump(SCENARIO, sort_keys=False))
    for path, value in changes.items():
        place = document
        *parents, last = path.split("__")
        for parent in parents:
            place = place.setdefault(parent, {})
        if value is None:
            del place[last]
        else:
            place[last] = value
    return document


def ran(folder: Path, document: dict[str, Any], name: str = "talk", overrides: Any = ()) -> Any:
    """Run a document and open its log."""
    path, log = folder / f"{name}.yaml", folder / f"{name}.mcap"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    summary = execute(build(path, overrides), log)
    assert summary.status == "finished", summary.failure
    return open_log(log)


def test_messages_are_in_the_log_from_beginning_to_end(tmp_path: Path) -> None:
    entries = list(ran(tmp_path, SCENARIO).communications())
    assert [(entry.time) for entry in entries] == sorted(entry.time for entry in entries)
    lives: dict[int, list[Any]] = {}
    for entry in entries:
        lives.setdefault(entry.id, []).append(entry)
    stages = Counter(tuple(entry.stage for entry in life) for life in lives.values())
    assert stages["SENT", "DELIVERED"] > 200
    assert stages["SENT", "DROPPED"] > 50
    assert stages["SENT", "DELIVERED", "DELIVERED"] > 10
    # Some are still under way at the end.
    assert all(stage[0] == "SENT" for stage in stages)
    for life in lives.values():
        first = life[0]
        assert first.payload
        assert first.size >= 32
        for entry in life:
            assert (entry.sender, entry.receiver, entry.kind) == (first.sender, first.receiver, first.kind)
            assert entry.sent_time == first.time
            assert (entry.reason == "loss") == (entry.stage == "DROPPED")
            assert entry.stage != "DELIVERED" or 0 < entry.latency < 1_000_000_000
    told = next(entry for entry in entries if entry.kind == "state")
    assert set(told.payload) == {"position", "velocity", "state", "goal"}
    assert told.payload["position"] == [3.0, 0.0]
    # position, velocity, state and goal are two numbers each.
    assert told.size == 32 + 8 * 8


def test_a_link_may_be_slower_than_others(tmp_path: Path) -> None:
    entries = [entry for entry in ran(tmp_path, SCENARIO).communications() if entry.stage == "DELIVERED"]
    slow, others = (
        [entry.latency for entry in entries if (entry.receiver == "robot.3") == is_slow] for is_slow in (True, False)
    )
    assert min(slow) >= 300_000_000
    assert np.median(others) < 150_000_000


def test_the_order_of_groups_changes_only_the_file(tmp_path: Path) -> None:
    turned = changed()
    turned["agents"] = dict(reversed(list(turned["agents"].items())))
    one, other = ran(tmp_path, SCENARIO), ran(tmp_path, turned, "turned")

    def fate(log: Path) -> Any:
        return sorted(
            (entry.id, entry.time, entry.stage, entry.receiver, entry.reason) for entry in untyped(log).communications()
        )

    assert fate(one) == fate(other)
    assert len(fate(one)) > 500
    for topic in ("/agents/robot/awareness", "/agents/car/awareness", "/world/robot/state"):
        assert digest_of(one, topic) == digest_of(other, topic)


def digest_of(log: Path, topic: str) -> Any:
    return [(message.time, message.data) for message in untyped(log).messages(topic)]


def test_another_agent_does_not_change_messages_of_others(tmp_path: Path) -> None:
    far = changed(agents__ghost={"model": {"use": "single-integrator"}, "state": [100.0, 100.0]})
    one, other = (
        {
            (entry.sender, entry.receiver, entry.sent_time, entry.time, entry.stage, entry.reason, entry.kind)
            for entry in log.communications()
        }
        for log in (ran(tmp_path, SCENARIO), ran(tmp_path, far, "far"))
    )
    assert one == other


def test_runs_are_equal_to_the_byte_in_both_modes(tmp_path: Path) -> None:
    path = tmp_path / "talk.yaml"
    path.write_text(yaml.safe_dump(SCENARIO))
    both = [assert_repeatable(path, [f"run.mode={mode}"]) for mode in ("synchronous", "asynchronous")]
    assert both[0].combined != both[1].combined
    assert list(ran(tmp_path, SCENARIO).communications())


def test_in_the_asynchronous_mode_messages_arrive_at_their_exact_time(tmp_path: Path) -> None:
    log = ran(tmp_path, changed(run__mode="asynchronous"))
    latencies = [entry.latency for entry in log.communications() if entry.stage == "DELIVERED"]
    assert sum(latency % STEP != 0 for latency in latencies) > 0.9 * len(latencies)
    synchronous = ran(tmp_path, SCENARIO, "synchronous")
    times = [entry.time for entry in synchronous.communications() if entry.stage == "DELIVERED"]
    assert all(time % STEP == 0 for time in times)
    assert len(times) == pytest.approx(len(latencies), abs=30)


def test_a_component_that_waits_for_messages_is_triggered_by_their_arrival(tmp_path: Path) -> None:
    document = changed(run__mode="asynchronous")
    hear = document["agents"]["robot"]["components"]["hear"]
    hear |= {"trigger": {"event": "received"}}
    log = ran(tmp_path, document)
    delivered = {entry.time for entry in log.communications() if entry.stage == "DELIVERED" and entry.receiver != "car"}
    aware = {message.time for message in log.messages("/agents/robot/awareness")}
    assert delivered
    assert delivered <= aware


def test_changes_of_links_are_events(tmp_path: Path) -> None:
    log = ran(tmp_path, SCENARIO)
    events = [event for event in log.events() if event.name == "links-changed"]
    assert events[0].time == 0
    assert len(events) > 1
    links = events[0].data["links"]
    for before, event in itertools.pairwise(events):
        links += len(event.data["begun"]) - len(event.data["ended"])
        assert event.data["links"] == links
        assert event.time > before.time


def test_a_promise_that_is_broken_on_the_way_is_reported(tmp_path: Path) -> None:
    document = changed(topology={"use": "range", "with": {"range": 2.0}, "connected": True})
    events = [event for event in ran(tmp_path, document).events() if event.name == "links-changed"]
    assert events[0].level == "WARNING"
    assert events[0].data["parts"] == 6


def test_topologies_change_when_they_should(tmp_path: Path) -> None:
    topology = {"use": "complete", "changes": [{"at": 0.5, "use": "line"}, {"at": 1.0, "use": "star"}], "repeat": 1.5}
    log = ran(tmp_path, changed(topology=topology))
    changes = [(event.time / 1e9, event.data["links"]) for event in log.events() if event.name == "links-changed"]
    assert changes == [(0.0, 30), (0.5, 10), (1.0, 10), (1.5, 30)]


@pytest.mark.parametrize(("messages", "stages"), [("dropped", {"DROPPED"}), ("none", set())])
def test_messages_may_be_left_out_of_the_log(messages: Any, stages: Any, tmp_path: Path) -> None:
    log = ran(tmp_path, changed(recording={"messages": messages}))
    assert {entry.stage for entry in log.communications()} == stages


def test_without_a_topology_every_agent_reaches_every_other_at_the_next_step(tmp_path: Path) -> None:
    log = ran(tmp_path, changed(topology=None))
    entries = list(log.communications())
    assert {entry.stage for entry in entries} == {"SENT", "DELIVERED"}
    assert {entry.latency for entry in entries if entry.stage == "DELIVERED"} == {STEP}
    assert not [event for event in log.events() if event.name == "links-changed"]
    first = [(entry.sender, entry.receiver) for entry in entries if entry.time == 0]
    ids = ["car", *(f"robot.{row}" for row in range(5))]
    assert sorted(first) == [pair for pair in itertools.product(ids, ids) if pair[0] != pair[1]]


@pytest.mark.usefixtures("known_plugins")
@pytest.mark.parametrize(
    ("use", "failure"),
    [
        ("broken.stray", "failed at 1 s: ValueError: a link ends at the agent of index 7, and there are 6 agents"),
        ("broken.short-lived", "failed at 1 s: RuntimeError: no more"),
    ],
)
def test_a_topology_that_fails_is_named(use: str, failure: str, tmp_path: Path) -> None:
    path, log = tmp_path / "talk.yaml", tmp_path / "talk.mcap"
    topology = {"use": "complete", "changes": [{"at": 1.0, "use": use}]}
    path.write_text(yaml.safe_dump(changed(topology=topology), sort_keys=False))
    summary = execute(build(path), log)
    assert summary.status == "failed"
    assert str(summary.failure) == f"topology.changes.0 ({use}) {failure}"
    (event,) = [event for event in open_log(log).events() if event.name == "failed"]
    assert (event.source, event.data["plugin"]) == ("topology.changes.0", use)


@pytest.mark.parametrize(
    ("channel", "links", "faults"),
    [
        ({"bandwidth": 300.0}, [{"sender": "car", "channel": {"queue": 100.0, "drop": "head"}}], {}),
        ({"queue": 100.0}, [{"receiver": "car", "channel": {"bandwidth": 300.0}}], {}),
        ({"drop": "head"}, [{"sender": "car", "channel": {"bandwidth": 300.0, "queue": 100.0}}], {}),
        ({"bandwidth": 300.0, "queue_length": 1}, [], {}),
        ({"queue_length": 1, "drop": "head"}, [], {"mud": {"at": 1.0, "degrade": {"bandwidth": 300.0}}}),
        ({"queue": 100.0}, [], {"mud": {"at": 1.0, "degrade": {"bandwidth": 300.0}}}),
        ({"queue": 100.0, "drop": "head"}, [], {"mud": {"at": 1.0, "degrade": {"bandwidth": 300.0}}}),
    ],
)
def test_a_channel_may_be_put_together_from_parts(channel: Any, links: Any, faults: Any, tmp_path: Path) -> None:
    topology = {"use": "complete", "channel": channel, "links": links}
    log = ran(tmp_path, changed(topology=topology, faults=faults))
    assert {entry.reason for entry in log.communications() if entry.stage == "DROPPED"} == {"queue-full"}


@pytest.mark.parametrize("drop", ["tail", "head"])
@pytest.mark.parametrize("bandwidth", [1000.0, 3000.0, 7000.0])
def test_a_queue_holds_its_length_regardless_of_the_bandwidth(bandwidth: float, drop: str, tmp_path: Path) -> None:
    tell = {"use": "communication.state", "period": 1.0}
    agents = {
        "one": {"model": {"use": "single-integrator"}, "components": {"a": tell, "b": tell, "c": tell}},
        "two": {"model": {"use": "single-integrator"}, "components": {"hear": {"use": "communication.inbox"}}},
    }
    channel = {"bandwidth": bandwidth, "queue": 160.0, "drop": drop}
    log = ran(tmp_path, changed(agents=agents, topology={"use": "complete", "channel": channel}))
    # Three messages of 80 bytes each, at once, every second.
    fates = Counter(entry.stage for entry in log.communications())
    assert fates == {"SENT": 6, "DELIVERED": 4, "DROPPED": 2}


def fate_of(log: Path, start: Any, end: Any) -> Any:
    entries = [
        entry for entry in untyped(log).communications() if entry.stage == "DROPPED" and start <= entry.time < end
    ]
    return {(entry.sender, entry.receiver) for entry in entries}, {entry.reason for entry in entries}


def test_links_can_be_cut_parted_degraded_and_restored(tmp_path: Path) -> None:
    faults = {
        "axe": {"at": 0.4, "for": 0.4, "cut": {"between": ["robot.0", "robot.[12]"]}},
        "river": {"at": 0.8, "partition": [["robot.[01]"], ["car", "robot.2"]]},
        "bridge": {"at": 1.2, "restore": "river"},
        "fog": {"at": 1.2, "degrade": {"sender": "robot.4", "loss": 1.0}},
        "mud": {"at": 1.6, "degrade": {"receiver": "car", "delay": 0.2}},
    }
    log = ran(tmp_path, changed(topology={"use": "complete"}, faults=faults))
    seconds = 10**9
    assert fate_of(log, 0, 0.4 * seconds) == (set(), set())
    cut = {("robot.0", "robot.1"), ("robot.1", "robot.0"), ("robot.0", "robot.2"), ("robot.2", "robot.0")}
    assert fate_of(log, 0.4 * seconds, 0.8 * seconds) == (cut, {"axe"})
    side = {"robot.0": 0, "robot.1": 0, "car": 1, "robot.2": 1, "robot.3": 2, "robot.4": 2}
    parted = {pair for pair in itertools.permutations(side, 2) if side[pair[0]] != side[pair[1]]}
    assert fate_of(log, 0.8 * seconds, 1.2 * seconds) == (parted, {"river"})
    fog = {("robot.4", other) for other in side if other != "robot.4"}
    assert fate_of(log, 1.2 * seconds, 2.0 * seconds) == (fog, {"fog"})
    late = {entry.latency for entry in log.communications(start=1_600_000_001) if entry.receiver == "car"}
    assert max(late) == 200_000_000
    over = [(event.time, event.data["fault"]) for event in log.events() if event.name == "fault-over"]
    assert over == [(800_000_000, "axe"), (1_200_000_000, "river")]


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_a_fault_at_0_comes_before_the_first_turns(tmp_path: Path, mode: str) -> None:
    faults = {"axe": {"at": 0.0, "cut": {"between": ["robot", "car"]}}}
    document = changed(topology={"use": "complete"}, faults=faults)
    document["run"] = {**document["run"], "mode": mode}
    log = ran(tmp_path, document)
    [begun] = (event for event in log.events() if event.name == "fault")
    assert begun.time == 0
    delivered = {(each.sender, each.receiver) for each in log.communications() if each.stage == "DELIVERED"}
    assert delivered
    assert not [pair for pair in delivered if "car" in pair]


def test_links_can_be_narrowed(tmp_path: Path) -> None:
    faults = {"sand": {"at": 0.4, "for": 0.4, "degrade": {"receiver": "robot.2", "bandwidth": 1000.0}}}
    log = ran(tmp_path, changed(topology={"use": "complete"}, faults=faults))
    delivered = [entry for entry in log.communications() if entry.stage == "DELIVERED"]
    late = {(each.receiver, each.time - each.latency) for each in delivered if each.latency > 50_000_000}
    assert late == {("robot.2", time * 100_000_000) for time in (4, 5, 6, 7)}


def test_a_fault_of_a_link_uses_the_random_draws_of_the_link(tmp_path: Path) -> None:
    faults = {"storm": {"at": 0.0, "drop": {"probability": 0.4}}}
    turned = changed(topology={"use": "complete"}, faults=faults)
    turned["agents"] = dict(reversed(list(turned["agents"].items())))
    logs = ran(tmp_path, changed(topology={"use": "complete"}, faults=faults)), ran(tmp_path, turned, "turned")
    one, other = (
        {(entry.id, entry.receiver) for entry in log.communications() if entry.stage == "DROPPED"} for log in logs
    )
    assert one == other
    assert one


def test_a_repeated_run_is_taken_from_the_log_alone(tmp_path: Path) -> None:
    log = ran(tmp_path, SCENARIO)
    again = tmp_path / "again.mcap"
    from symaware_cli.language.files import open_scenario

    execute(open_scenario(log.path), again)
    assert digest(log).channels == digest(open_log(again)).channels


@pytest.mark.parametrize("fault", [{"stop": "robot.1"}, {"freeze": "robot.1.tell"}])
def test_an_excluded_agent_sends_no_messages(fault: dict[str, str], tmp_path: Path) -> None:
    faults = {"end": {"at": 0.5, "for": 0.5, **fault}}
    log = ran(tmp_path, changed(topology={"use": "complete"}, faults=faults))
    said = {entry.time for entry in log.communications() if entry.stage == "SENT" and entry.sender == "robot.1"}
    assert said == {time for time in range(0, 2_000_000_000, 100_000_000) if not 500_000_000 <= time < 1_000_000_000}
    others = {entry.time for entry in log.communications() if entry.stage == "SENT" and entry.sender == "robot.2"}
    assert others == set(range(0, 2_000_000_000, 100_000_000))
